"""``sympol train``: a new training in a run's folder."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import tyro

from ..algorithms.config import SIZE_LIMITS, Config
from ..algorithms.presets import DEFAULT, preset
from ..runs.metadata import CONFIG, RunError, file_name
from ..runs.run import Run
from .arguments import EnvKwargs, MaxRules, Text, env_kwargs, parse
from .console import err
from .tree_io import tree_from

if TYPE_CHECKING:
    from ..agents import Agent
    from ..algorithms.warm_start import Start
    from ..envs.spec import EnvSpec


@dataclass
class Train:
    """Train a decision tree by PPO (or A2C: --algorithm; or another policy: --policy) and save it in a run's folder.

    On a Gymnasium id: sympol train CartPole-v1

    On a class or a function in a file: sympol train tank.py:Tank --env-kwargs size=3 --total-timesteps 200k
    """

    env: Text
    """Gymnasium id, such as CartPole-v1, or what makes the environment in a file or module: file.py:Name or
    module:Name."""

    seed: int = 0
    """Seed of everything random; the same seed on the same machine gives the same tree."""

    preset: str = DEFAULT
    """Source of the hyperparameters: default (ours), paper, or the path of a .toml file (sympol tune)."""

    run_dir: Path | None = None
    """The run's folder; by default the next free one under runs/."""

    overwrite: bool = False
    """Replace the run in --run-dir."""

    resume: bool = False
    """Resume the run in --run-dir."""

    env_kwargs: EnvKwargs = ()
    """Arguments of the environment, such as view_size=5 or continuous=true."""

    backend: Literal["auto", "jax", "native", "host"] = "auto"
    """jax: inside the compiled program; native: machine code; host: through Gymnasium; auto: the first of these that
    the environment has."""

    env_workers: int = 0
    """Number of processes that step the copies of a Gymnasium environment, for one whose steps take a millisecond or
    more; 0 steps them in this process. The tree is the same to the bit."""

    start: Path | None = None
    """The tree to start from: a run's folder, a policy.json, or a listing in a .txt. By default --depth is that of the
    preset, or that of the tree if it is deeper."""

    freeze_nodes: tuple[int, ...] = ()
    """Nodes of the --start tree that stay as they are, numbered as in policy.json, from 0, the root."""

    freeze: str | None = None
    """A condition, such as "pole angle > 0.1 and cart velocity > 0": where it holds, the actions stay those of the
    --start tree."""

    start_confidence: float = 0.7
    """Initial probability of a leaf's action where the --start tree is almost certain of it."""

    critic_warmup: float = 0.05
    """Fraction of the training, after --start, in which only the critic learns."""

    max_rules: MaxRules = None
    """Most rules, that is leaves, of the tree: --max-nodes 2 N - 1 in other words."""

    eval_episodes: int = 20
    """Number of test episodes on Gymnasium at the end."""

    tensorboard: bool = False
    """Also write TensorBoard logs into the run."""

    json: bool = False
    """Print only the summary, as one line of JSON."""

    config: Annotated[Config, tyro.conf.arg(name="")] = field(default_factory=Config)


def run(words: Sequence[str]) -> int:
    """Run ``sympol train``."""
    given = parse_train(words)
    if given.eval_episodes < 1:
        raise ValueError(f"--eval-episodes must be at least 1, got {given.eval_episodes}")
    if not given.env:
        raise ValueError("name an environment, as in: sympol train CartPole-v1")

    from ..agents import agent_of
    from ..algorithms.memory import require_memory
    from ..envs.registry import resolve
    from ..runs.metrics import TensorBoard
    from .learn import learn
    from .resume import continue_run

    spec = resolve(given.env, env_kwargs=env_kwargs(given.env_kwargs), backend=given.backend)
    spec = spec.stepped_by(given.env_workers)
    agent = agent_of(spec, given.config, given.seed, _start(given, spec))
    if given.resume:
        return continue_run(_same_run(given, agent), given.eval_episodes, given.json, given.env_workers)
    if given.tensorboard:
        TensorBoard.require()
    require_memory(spec, agent.config)
    path = given.run_dir or _next_free(Path("runs"), spec.short_name)
    with Run.create(
        path,
        spec,
        agent.config,
        agent.seed,
        preset=given.preset,
        eval_episodes=given.eval_episodes,
        overwrite=given.overwrite or _ask(path),
        start=agent.start,
    ) as made:
        return learn(agent, made, given.eval_episodes, given.json, tensorboard=given.tensorboard)


def parse_train(words: Sequence[str]) -> Train:
    """Parse the arguments of ``sympol train``, where the preset gives the values of flags that are not given.

    There are two passes: the first finds the environment and the preset.

    Raises:
        ValueError: A word is unknown or has a wrong value.
    """
    first: Any = _unchecked()()
    with contextlib.suppress(ValueError):  # the second pass raises it
        asks = {"-h", "--help"} & set(words)
        first = parse(type(first), "train", [a for a in words if a not in asks])
    which = {
        "algorithm": first.config.algorithm or Config.algorithm,
        "policy": first.config.policy or Config.policy,
    }
    chosen = {field.name: getattr(first.config, field.name) for field in dataclasses.fields(Config)}
    values = preset(
        "" if first.env_kwargs else first.env,
        first.preset,
        given={name: value for name, value in chosen.items() if value is not None},
        from_tree=first.start is not None,
        **which,
    )
    if first.start is not None and which["policy"] == "tree":
        values = {**values, "depth": max(values.get("depth", Config.depth), tree_from(first.start).depth)}
    return parse(Train, "train", words, Train("", config=Config.from_dict({**which, **values})))


def _unchecked() -> type:
    """Return `Train` with a config of any values: without its preset, the given values need not fit together.

    What is not given is None there, except flags without a value.
    """
    fields = make_dataclass(
        "Fields",
        [of if of[1] is bool else (of[0], of[1] | None, None) for of in _fields_of(Config)],
    )
    config = ("config", Annotated[fields, tyro.conf.arg(name="")], field(default_factory=fields))
    return make_dataclass("First", [*(f for f in _fields_of(Train) if f[0] != "config"), config])


def _fields_of(kind: type) -> list[tuple[str, Any, Any]]:
    hints = get_type_hints(kind, include_extras=True)
    return [
        (f.name, hints[f.name], "" if f.default is dataclasses.MISSING else f.default)
        for f in dataclasses.fields(kind)
    ]


def _start(given: Train, spec: EnvSpec) -> Start | None:
    """Return the tree that ``--start`` names, and how to start from it, or None without ``--start``.

    Args:
        given: The arguments of the command.
        spec: The environment.

    Raises:
        RunError: There is no tree.
        ValueError: A flag needs ``--start`` or does not fit the tree, or the tree does not fit the environment.
    """
    from ..algorithms.warm_start import Start, start_of

    if given.start is None:
        alone = {"--freeze-nodes": given.freeze_nodes, "--freeze": given.freeze}
        for flag, value in alone.items():
            if value:
                raise ValueError(f"{flag} is about the tree to start from: give --start, too")
        return None
    start = Start(
        tree_from(given.start),
        freeze=given.freeze_nodes,
        confidence=given.start_confidence,
        critic_warmup=given.critic_warmup,
        origin=str(given.start),
        origin_return=_known_return(given.start),
    )
    return start_of(start, given.freeze or (), spec)


def _known_return(path: Path) -> float | None:
    """Return the tree's mean return in test episodes, if it is a finished run's."""
    folder = path if path.is_dir() else path.parent
    if not (folder / CONFIG).is_file() or (path.is_file() and path.name != "policy.json"):
        return None
    with contextlib.suppress(RunError):
        value = (Run.open(folder).load_summary() or {}).get("return_mean")
        return float(value) if isinstance(value, int | float) else None
    return None


def _same_run(given: Train, agent: Agent) -> Run:
    """Return the run in --run-dir, whose arguments must be the given ones."""
    if given.run_dir is None or given.overwrite:
        raise RunError("--resume needs the run's folder, as --run-dir, and excludes --overwrite")
    run = Run.open(given.run_dir)
    metadata = run.metadata
    made = agent.spec.origin.to_dict()
    was = {
        "env": metadata["env"],
        **{name: metadata[name] for name in made},
        "seed": run.seed,
        **run.config.to_dict(),
    }
    spec = agent.spec
    now = {"env": spec.name, **made, "seed": agent.seed, **agent.config.to_dict()}
    begun, begins = run.load_start(), agent.start
    was["start"], now["start"] = (None if start is None else start.about() for start in (begun, begins))
    for config, values in ((run.config, was), (agent.config, now)):
        values.update(
            {name: getattr(config, name) for name in SIZE_LIMITS}
        )  # which are not written where there are none
    changed = [f"{name} {was[name]}, not {now[name]}" for name in was if was[name] != now[name]]
    if begun is not None and begins is not None and begun.tree != begins.tree:
        changed.append(f"another tree in {begins.origin}")
    if changed:
        raise RunError(
            f"{run.path} was begun with {', '.join(changed)}; to resume it as it was: sympol resume "
            f"{run.as_argument}"
        )
    return run


def _next_free(folder: Path, name: str) -> Path:
    """Make and return the folder ``name`` with the first number that is free."""
    number = 1
    while True:
        path = folder / f"{file_name(name)}-{number}"
        try:
            path.mkdir(parents=True)
            return path
        except FileExistsError as error:
            if folder.exists() and not folder.is_dir():
                raise RunError(f"{folder} is a file; choose a --run-dir") from error
            number += 1
        except OSError as error:
            raise RunError(f"cannot write {path}: {error.strerror}; choose another --run-dir") from error


def _ask(path: Path) -> bool:
    """Ask at the terminal whether a run that is there may be replaced; without a terminal it may not."""
    if not (path / "config.toml").exists() or not sys.stdin.isatty() or not sys.stderr.isatty():
        return False
    err.print(f"{path} already holds a run. Replace it? [y/N] ", markup=False, end="")
    return input().strip().lower() in ("y", "yes")
