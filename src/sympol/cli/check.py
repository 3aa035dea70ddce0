"""``sympol check``: what sympol sees of an environment, what is wrong with it, and how it would be trained."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ..algorithms.presets import DEFAULT
from .arguments import EnvKwargs, Text, env_kwargs, parse
from .console import out, print_error, print_steps, program
from .summary import with_teacher

if TYPE_CHECKING:
    from ..algorithms.config import Config
    from ..algorithms.work import Work
    from ..envs.inspection import Inspection
    from ..envs.problems import Problem
    from ..envs.spec import EnvSpec

_SHOWN = 8
"""The number of features and actions that are named."""


@dataclass
class Check:
    """Play an environment at random for a few seconds, and say what sympol sees, what is wrong, and what training does.

    A class, a function or an id in a file of yours: sympol check tank.py:Tank

    A Gymnasium id, with arguments: sympol check LunarLander-v3 --env-kwargs enable_wind=true

    What is marked as wrong makes a training useless or impossible to repeat, and the exit status 1; notes are worth
    knowing. Nothing is written.
    """

    env: Annotated[Text, tyro.conf.arg(metavar="ENV")]
    """A Gymnasium id, or what makes the environment in a module or a file: file.py:Name."""

    env_kwargs: EnvKwargs = ()
    """Arguments of the environment, such as view_size=5 or continuous=true."""

    total_timesteps: int | None = None
    """Environment steps of the training that is planned; by default those of its preset."""

    preset: str = DEFAULT
    """Source of the hyperparameters: default, paper, or the path of a .toml file."""

    seconds: float = 3.0
    """How long to play."""

    seed: int = 0
    """Seed of the episodes and of the random actions."""

    json: bool = False
    """Print one line of JSON."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol check``.

    Args:
        words: The words after the command's name.

    Returns:
        The exit status: 1 if something is wrong, else 0.

    Raises:
        ValueError: An argument is out of range, or the environment cannot be described.
    """
    given = parse(Check, "check", words)
    if not 0 <= given.seconds <= 3600:
        raise ValueError(f"--seconds must be between 0 and 3600, got {given.seconds:g}")

    from ..agents import PPO
    from ..envs.errors import EnvironmentFailure
    from ..envs.inspection import inspect_env
    from ..envs.problems import problems
    from ..envs.registry import resolve

    spec = resolve(given.env, env_kwargs=env_kwargs(given.env_kwargs))
    steps: dict[str, Any] = (
        {} if given.total_timesteps is None else {"total_timesteps": given.total_timesteps}
    )
    config = PPO("tree", spec, preset=given.preset, **steps).config
    try:
        seen = inspect_env(spec, seconds=given.seconds, seed=given.seed)
        found = problems(seen)
    except EnvironmentFailure as error:
        if given.json:
            print(json.dumps({"env": spec.name, "wrong": [str(error)], "notes": []}))
        else:
            _print_rows(_described(spec))
            print_error(error)
        return 1
    wrong = [problem.text for problem in found if problem.kind == "wrong"]
    if given.json:
        print(json.dumps(_fields(seen, config, found)))
        return int(bool(wrong))
    _print_rows([*_described(spec), *_measured(seen), *_planned(seen, config, given.preset)])
    out.print()
    for problem in found:
        mark = "[bold red]wrong[/]" if problem.kind == "wrong" else "[bold yellow]note [/]"
        out.print(f"{mark} ", end="")
        out.print(problem.text, markup=False)
    if not found:
        out.print("nothing is wrong with it that random play can show", markup=False)
    if not wrong:
        print_steps([(f"{program()} train {' '.join(_arguments(given))}", "train a tree on it")])
    return int(bool(wrong))


def _arguments(given: Check) -> list[str]:
    kwargs = ["--env-kwargs", *given.env_kwargs] if given.env_kwargs else []
    steps = [] if given.total_timesteps is None else ["--total-timesteps", str(given.total_timesteps)]
    preset = [] if given.preset == DEFAULT else ["--preset", given.preset]
    return [shlex.quote(word) for word in (given.env, *kwargs, *steps, *preset)]


def _print_rows(rows: Sequence[tuple[str, str]]) -> None:
    for name, text in rows:
        out.print(f"{name:<13} {text}", markup=False, highlight=False)


def _described(spec: EnvSpec) -> list[tuple[str, str]]:
    """Return the lines about what an environment declares."""
    form = {"jax": "written in JAX, trained inside one compiled program", "native": "stepped by machine code"}
    limit = "none declared" if spec.max_episode_steps is None else f"{spec.max_episode_steps:,} steps"
    return [
        ("environment", f"{spec.name}, {form.get(spec.backend, 'through Gymnasium')}"),
        ("observations", _features(spec)),
        ("actions", _actions(spec)),
        ("time limit", limit),
    ]


def _features(spec: EnvSpec) -> str:
    features = spec.features
    grouped = {i: group for group in features.groups for i in group.features}
    parts, shown = [], set()
    for i, name in enumerate(features.names):
        group = grouped.get(i)
        if group is None:
            low, high = features.low[i], features.high[i]
            bounds = "" if low == -high and high == float("inf") else f" {_bound(low)} to {_bound(high)}"
            parts.append(f"{name}{bounds}")
        elif id(group) not in shown:
            shown.add(id(group))
            parts.append(f"one of {', '.join(group.categories[:_SHOWN])}{_rest(len(group.categories))}")
    count = len(features.names)
    return f"{count} feature{'s' if count > 1 else ''}: {'; '.join(parts[:_SHOWN])}{_rest(len(parts))}"


def _actions(spec: EnvSpec) -> str:
    actions: Any = spec.actions
    if hasattr(actions, "low"):
        numbers = zip(actions.names, actions.low, actions.high, strict=True)
        parts = [f"{name} {_bound(low)} to {_bound(high)}" for name, low, high in numbers]
    elif hasattr(actions, "options"):
        parts = [
            f"{name} of {', '.join(some)}" for name, some in zip(actions.names, actions.options, strict=True)
        ]
    else:
        return f"one of {', '.join(actions.names[:_SHOWN])}{_rest(len(actions.names))}"
    return f"{len(parts)}: {'; '.join(parts[:_SHOWN])}{_rest(len(parts))}"


def _measured(seen: Inspection) -> list[tuple[str, str]]:
    ended = seen.episodes
    unit = "ms" if seen.step_seconds >= 1e-4 else "µs"
    factor = 1e3 if unit == "ms" else 1e6
    lines = [
        (
            "speed",
            f"{seen.steps_per_second:,.0f} steps/s of one copy in Python; a step takes "
            f"{factor * seen.step_seconds:.3g} "
            f"{unit}, a reset {factor * seen.reset_seconds:,.3g} {unit}",
        ),
        ("reward", f"{seen.reward_low:g} to {seen.reward_high:g} a step, in {seen.steps:,} random steps"),
    ]
    if ended.lengths:
        mean = sum(ended.returns) / len(ended.returns)
        lines.append(
            (
                "episodes",
                f"{len(ended.lengths)} of {min(ended.lengths):,} to {max(ended.lengths):,} steps, "
                f"{ended.terminated} ended by themselves and {len(ended.lengths) - ended.terminated} by a time "
                "limit; return "
                f"{mean:,.4g} on average "
                f"({min(ended.returns):,.4g} to {max(ended.returns):,.4g})",
            )
        )
    else:
        lines.append(("episodes", f"none ended within {seen.steps:,} steps"))
    return lines


def _planned(seen: Inspection, config: Config, preset: str) -> list[tuple[str, str]]:
    from ..algorithms.presets import presets_of

    spec, work = seen.spec, _work(seen.spec, config)
    known = preset != DEFAULT or bool(presets_of(spec.preset_id) if spec.preset_id else {})
    source = (
        f"the preset {preset} of {spec.name}" if known else "the defaults for environments without a preset"
    )
    lengths = seen.episodes.lengths
    steps = round(work.validation_episodes * sum(lengths) / len(lengths)) if lengths else 0
    at_most = "at most " if config.eval_share and spec.backend == "host" else ""
    if at_most:
        steps = min(steps, round(config.eval_share * config.total_timesteps))
    beside = f", about {steps:,} steps of their own if they last as long as at random" if steps else ""
    plan = [
        (
            "recipe",
            f"{source}: a tree of depth {config.depth} by {config.algorithm.upper()}, "
            f"{config.total_timesteps:,} steps in "
            f"{config.num_envs} copies, {work.optimizer_steps:,} optimizer steps{with_teacher(config)}",
        ),
        ("validation", f"{work.validations} times {at_most}{config.num_eval_episodes} episodes{beside}"),
    ]
    if spec.backend == "host":
        seconds = (config.total_timesteps + steps) / seen.steps_per_second
        plan.append(("time", f"about {_duration(seconds)} in the environment itself, on one core"))
    return plan


def _work(spec: EnvSpec, config: Config) -> Work:
    from ..algorithms.teaching import teacher_config
    from ..algorithms.work import work_of

    return work_of(config, teacher_config(spec.preset_id, config) if config.method == "auto" else None)


def _fields(seen: Inspection, config: Config, found: Sequence[Problem]) -> dict[str, Any]:
    spec = seen.spec
    return {
        "env": spec.name,
        "backend": spec.backend,
        "features": list(spec.features.names),
        "actions": list(spec.actions.names),
        "max_episode_steps": spec.max_episode_steps,
        "steps_per_second": round(seen.steps_per_second),
        "step_seconds": seen.step_seconds,
        "reset_seconds": seen.reset_seconds,
        "reward": [seen.reward_low, seen.reward_high],
        "random_returns": seen.episodes.returns,
        "episode_lengths": seen.episodes.lengths,
        "config": config.to_dict(),
        **_work(spec, config)._asdict(),
        "wrong": [problem.text for problem in found if problem.kind == "wrong"],
        "notes": [problem.text for problem in found if problem.kind != "wrong"],
    }


def _bound(value: float) -> str:
    infinite = {float("inf"): "any", float("-inf"): "any"}
    return infinite.get(float(value), f"{value:g}")


def _rest(count: int) -> str:
    return f" and {count - _SHOWN} more" if count > _SHOWN else ""


def _duration(seconds: float) -> str:
    for unit, size in (("h", 3600), ("min", 60)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"
