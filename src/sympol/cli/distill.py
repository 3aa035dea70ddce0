"""The command that makes a tree of a teacher, distill: a run, a stable-baselines3 zip, or a function."""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..agents import Agent, load_run
from ..algorithms.config import Config
from ..distill import Iteration, Teacher, load_sb3
from ..distill.dataset import Limits
from ..envs.registry import resolve
from ..envs.spec import EnvSpec
from ..play import play
from ..provenance import versions
from ..runs.clearing import require_free
from ..runs.metadata import RunError, file_name
from ..runs.run import Run
from ..teachers import ALL_METHODS, DISCRETIZE, as_teacher, default_method, distill_policy
from ..trees import DecisionTree
from ..trees.actions import BoxActions
from .arguments import Distill
from .console import err, one_line_errors, out, print_next, summary_words
from .learn import EVAL_SEED
from .parse import env_kwargs, parse

_IN_TURNS = {"episodes": "episodes_per_iteration", "iterations": "num_iterations"}
_NODES = {"max_nodes": "max_nodes"}
_OPTIONS = {
    "sa-dt": {"episodes": "num_episodes", **_NODES},
    "viper": {**_IN_TURNS, **_NODES},
    "dagger": {**_IN_TURNS, **_NODES},
}
"""What the flags are to each method."""


@one_line_errors()
def distill(arguments: Sequence[str]) -> int:
    """``sympol distill``."""
    given = parse(Distill, "distill", arguments)
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
    ) as run:
        summary = _finish(run, teacher, full, tree, given.eval_episodes) | {
            "distill_seconds": round(seconds, 3)
        }
        run.save_summary(summary)
    if given.json:
        print(json.dumps(summary))
        return 0
    out.print(run.load_tree().to_text(), markup=False)
    out.print(summary_words(summary))
    print_next(run)
    return 0


def find_teacher(given: Distill) -> tuple[Any, Teacher]:
    """What TEACHER names: as it is, and as a teacher that plays in --env."""
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
    if colon and not path.exists():
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
    if given.env is None:
        raise ValueError(
            f"--env must name the environment of {given.teacher}, as in --env CartPole-v1: only a run knows its own"
        )
    return resolve(given.env, env_kwargs=env_kwargs(given.env_kwargs), backend="host")


def _import(module: str, name: str) -> Any:
    """``module:function``, the working directory's modules included, as ``python -m`` finds them."""
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        found: Any = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f"cannot import {module}:{name} ({error}); TEACHER is a run's folder, the zip of a stable-baselines3 "
            "model, or module:function"
        ) from error
    return found


def _options(given: Distill, method: str) -> dict[str, Any]:
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
    """What the limits will be; only discretize does not choose its depth."""
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
    return Path("runs") / f"{file_name(spec.name)}-{name}"


def _finish(
    run: Run, teacher: Teacher, full: DecisionTree, tree: DecisionTree, episodes: int
) -> dict[str, Any]:
    """Test tree and teacher on the same episodes, write the tree in every form; return what came of it."""
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
    """How alike the two act where the teacher came by: the share of equal actions, or how far apart they are."""
    ours, its = tree.predict(x).reshape(len(x), -1), teacher.act(x).reshape(len(x), -1)
    if isinstance(teacher.spec.actions, BoxActions):
        return {"action_difference": float(np.abs(ours - its).mean())}
    return {"agreement": float((ours == its).all(axis=1).mean())}
