"""``sympol distill``: a tree of a teacher, which is a run, a stable-baselines3 model or a function."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..algorithms.config import Config
from ..provenance import versions
from ..runs.clearing import require_free
from ..runs.metadata import RunError, file_name
from ..runs.run import Run
from ..trees import DecisionTree
from ..trees.actions import BoxActions
from .arguments import EnvKwargs, MaxRules, Text, env_kwargs, parse
from .console import err, out
from .summary import format_summary, print_next

if TYPE_CHECKING:
    from ..distill import Iteration, Teacher
    from ..envs.spec import EnvSpec

_IN_TURNS = {"episodes": "episodes_per_iteration", "iterations": "num_iterations"}
_NODES = {"max_nodes": "max_nodes"}
_OPTIONS = {
    "sa-dt": {"episodes": "num_episodes", **_NODES},
    "viper": {**_IN_TURNS, **_NODES},
    "dagger": {**_IN_TURNS, **_NODES},
}
"""The arguments of each method that the flags set."""


@dataclass
class Distill:
    """Distill a policy into a decision tree, save it as a run, and compare the returns of both."""

    teacher: Text
    """A run's folder, the zip of a stable-baselines3 model, or module:function or file.py:function, from an
    observation to an action."""

    method: Literal["viper", "dagger", "sa-dt", "discretize"] | None = None
    """By default discretize for a soft tree, viper for a teacher with action values, else dagger."""

    depth: int | None = None
    """Maximum depth: 5 by default, unlimited with --max-nodes; with discretize, the soft tree's."""

    max_nodes: int | None = None
    """Maximum number of nodes, leaves included, an odd number: the tree grows where that gains most."""

    max_rules: MaxRules = None
    """Maximum number of leaves, in place of --max-nodes: a tree of N rules has 2 N - 1 nodes."""

    env: str | None = None
    """Gymnasium id of the teacher's environment, or file.py:Name or module:Name; a run knows its own,
    if its folder can make it."""

    env_kwargs: EnvKwargs = ()
    """Arguments of --env, such as view_size=5."""

    trust: bool = False
    """Unpickle the zip, or import the module or file that a run's folder names: both run code of their author."""

    seed: int = 0
    """Seed of everything random; the same seed gives the same tree."""

    episodes: int | None = None
    """Teacher episodes: of viper and dagger per iteration (10), of sa-dt in all (25)."""

    iterations: int | None = None
    """Number of trees that viper and dagger fit, of which they return the best (20)."""

    eval_episodes: int = 20
    """Number of test episodes on Gymnasium, the same for the tree and its teacher."""

    out: Path | None = None
    """The tree's folder; by default RUN/distilled/METHOD-DEPTH, or runs/ENV-METHOD-DEPTH, or METHOD-63-nodes."""

    overwrite: bool = False
    """Replace the run in the folder."""

    json: bool = False
    """Print only the summary, as one line of JSON."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol distill``."""
    given = parse(Distill, "distill", words)

    from ..teachers import default_method, distill_policy

    if given.env is None and given.env_kwargs:
        raise ValueError("--env-kwargs says how to make --env, so give that, too")
    if given.eval_episodes < 1:
        raise ValueError(f"--eval-episodes must be at least 1, got {given.eval_episodes}")
    policy, teacher = find_teacher(given)
    method = given.method or default_method(policy, teacher)
    options, size = _options(given, method), _size(given, method, policy)
    path = _folder(given, teacher.spec, "-".join([method, *_size_words(size)]))
    require_free(path, overwrite=given.overwrite, distilled=True)  # before the work, not after it
    began = time.perf_counter()
    with err.status(f"distilling by {method}") as status:
        if method in ("viper", "dagger"):
            options["progress"] = lambda iteration: status.update(_progress_words(method, iteration))
        full = distill_policy(
            policy, method, given.depth, env=teacher.spec, seed=given.seed, prune=False, **options
        )
    seconds = time.perf_counter() - began
    tree = full.prune(observations=teacher.spec.all_observations())
    with Run.create(
        path,
        teacher.spec,
        Config(),
        given.seed,
        eval_episodes=given.eval_episodes,
        overwrite=given.overwrite,
        distilled={"method": method, **size, "seed": given.seed, "teacher": given.teacher},
    ) as made:
        summary = _finish(made, teacher, full, tree, given.eval_episodes) | {
            "distill_seconds": round(seconds, 3)
        }
        made.save_summary(summary)
    if given.json:
        print(json.dumps(summary))
        return 0
    out.print(made.load_tree().to_text(), markup=False)
    out.print(format_summary(made, summary))
    print_next(made)
    return 0


def find_teacher(given: Distill) -> tuple[Any, Teacher]:
    """Return the policy that TEACHER names, and the same as a teacher that plays in --env."""
    from ..agents import load_run
    from ..distill import load_sb3
    from ..teachers import as_teacher

    path = Path(given.teacher)
    if path.is_dir():
        spec = None if given.env is None else _spec(given)
        run = Run.open(path, trust=given.trust)
        agent = load_run(run if spec is None or not run.metadata["not_kept"] else Run.open(path, spec))
        if agent.num_timesteps < agent.config.total_timesteps:
            raise RunError(
                f"{path} is not finished ({agent.num_timesteps:,} of {agent.config.total_timesteps:,} steps); finish "
                f"it: sympol resume {run.as_argument}"
            )
        return agent, as_teacher(agent, spec)
    module, colon, name = given.teacher.rpartition(":")
    if colon and name and not path.exists():
        policy = _import(module, name)
        return policy, as_teacher(policy, _spec(given))
    if not path.exists() and not path.with_name(f"{path.name}.zip").exists():
        raise RunError(
            f"there is no teacher {given.teacher!r}; give a run's folder, the zip of a stable-baselines3 model, or "
            "module:function"
        )
    teacher = load_sb3(path, _spec(given), trust=given.trust)
    return teacher, teacher


def _spec(given: Distill) -> EnvSpec:
    from ..envs.registry import resolve

    if given.env is None:
        raise ValueError(
            f"--env must name the environment of {given.teacher}, as in --env CartPole-v1: only a run knows its own"
        )
    return resolve(given.env, env_kwargs=env_kwargs(given.env_kwargs), backend="host")


def _import(module: str, name: str) -> Any:
    from ..envs.user_code import CodeNotFound, find

    try:
        return find(module, name)
    except CodeNotFound as error:
        raise CodeNotFound(
            f"cannot import {module}:{name} ({error}); TEACHER is a run's folder, the zip of a stable-baselines3 "
            "model, or module:function"
        ) from error


def _options(given: Distill, method: str) -> dict[str, Any]:
    from ..teachers import ALL_METHODS

    flags = {"episodes": given.episodes, "iterations": given.iterations, "max_nodes": given.max_nodes}
    named = _OPTIONS.get(method, {})
    for flag, value in flags.items():
        if value is not None and flag not in named:
            which = ", ".join(name for name in ALL_METHODS if flag in _OPTIONS.get(name, {}))
            raise ValueError(
                f"--{flag.replace('_', '-')} belongs to {which}; {method} has none, so leave it out"
            )
    return {named[flag]: value for flag, value in flags.items() if value is not None}


def _size(given: Distill, method: str, policy: Any) -> dict[str, int]:
    """Return the limits of the tree; only discretize does not choose its depth."""
    from ..agents import Agent
    from ..distill.dataset import Limits
    from ..teachers import DISCRETIZE

    if method == DISCRETIZE and isinstance(policy, Agent):
        return {"depth": policy.config.depth}
    limits = Limits.of(given.depth, given.max_nodes)._asdict()
    return {name: limit for name, limit in limits.items() if limit is not None}


def _size_words(size: dict[str, int]) -> list[str]:
    words = {"depth": "{}", "max_nodes": "{}-nodes"}
    return [words[name].format(limit) for name, limit in size.items()]


def _progress_words(method: str, at: Iteration) -> str:
    returns = f"return {at.mean_return:,.1f}, best {at.best_return:,.1f}"
    return f"{method}: tree {at.iteration} of {at.num_iterations}, {returns}"


def _folder(given: Distill, spec: EnvSpec, name: str) -> Path:
    if given.out is not None:
        return given.out
    if Path(given.teacher).is_dir():
        return Path(given.teacher) / "distilled" / name
    return Path("runs") / f"{file_name(spec.short_name)}-{name}"


def _finish(
    run: Run, teacher: Teacher, full: DecisionTree, tree: DecisionTree, episodes: int
) -> dict[str, Any]:
    """Test tree and teacher on the same episodes, write the tree in every form; return what came of it."""
    from ..play import play
    from .learn import EVAL_SEED

    its = play(teacher, teacher.spec, episodes, seed=EVAL_SEED)
    tested = play(tree, teacher.spec, episodes, seed=EVAL_SEED)
    run.save_tree(tree.with_visits(tested.observations))
    return {
        "env": teacher.spec.name,
        "return_mean": float(tested.returns.mean()),
        "return_std": float(tested.returns.std()),
        "teacher_return_mean": float(its.returns.mean()),
        "teacher_return_std": float(its.returns.std()),
        **_likeness(teacher, tree, its.observations),
        "episodes": episodes,
        "eval_seed": EVAL_SEED,
        "nodes": tree.n_nodes,
        "nodes_unpruned": full.n_nodes,
        "leaves": tree.n_leaves,
        "depth": tree.depth,
        "distilled": run.metadata["distilled"],
        "run_dir": str(run.path),
        "versions": versions(),
    }


def _likeness(teacher: Teacher, tree: DecisionTree, x: np.ndarray) -> dict[str, float]:
    """Return the share of equal actions on the teacher's observations, or the mean difference of continuous ones."""
    ours, its = tree.predict(x).reshape(len(x), -1), teacher.act(x).reshape(len(x), -1)
    if isinstance(teacher.spec.actions, BoxActions):
        return {"action_difference": float(np.abs(ours - its).mean())}
    return {"agreement": float((ours == its).all(axis=1).mean())}
