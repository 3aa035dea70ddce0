"""The report of one run: its tree, episodes, returns, training, properties and programs in one page."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ..envs.spec import EnvSpec
from ..play import Episodes, episode_seed, play
from ..runs.formatting import format_return
from ..runs.run import Run
from ..trees.floats import printable
from ..trees.report import policy_data, programs_data, size_facts, write_page
from .data import check_test, checks_data, properties_of, tests_data
from .episodes import drawing_of, filmed

_CURVES = {"eval/mean_reward": "validation, deterministic", "rollout/ep_rew_mean": "training, exploring"}


def report(
    run: Run,
    *,
    episodes: int = 100,
    seed: int = 7,
    properties: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> str:
    """Write the page of a run, whose policy is a tree.

    Args:
        run: The run.
        episodes: Number of test episodes, those of `evaluate_policy` with the same seed. The worst, the median and the
            best are in the page.
        seed: Seed of the episodes.
        properties: A file of properties to prove; by default RUN/safety.toml, if it is there.
        progress: Called with a line of text about what is being done.

    Returns:
        The page, as HTML.

    Raises:
        RunError: The run has no tree, or cannot be read.
        ValueError: An argument is out of bounds, Gymnasium lacks the environment, or the file holds no properties of
            this tree.
        OSError: The file cannot be read.
    """
    check_test(episodes, seed)
    tell = progress or (lambda words: None)
    tree, spec = run.load_tree(), run.resolve_env()
    file = properties_of(run, properties)
    checks = None if file is None else checks_data(tree, file)
    tell(f"playing {episodes} test episodes")
    tested = play(tree, spec, episodes, seed=seed)
    tree = tree.with_visits(tested.observations)
    summary = run.load_summary() or {}
    tests = tests_data(tested, seed)
    data = {
        "title": printable(spec.name),
        "kicker": "decision tree"
        + (", distilled" if run.is_distilled else f", trained by {_algorithm(run)}"),
        "facts": [[tests["words"], f"return, {episodes} test episodes"], *size_facts(tree)],
        "policy": policy_data(tree, tested.observations),
        "player": _player(tree, spec, tested, seed, tell),
        "tests": tests,
        "curve": _curve(run),
        "checks": checks,
        "programs": programs_data(tree),
        "provenance": {"rows": _provenance(run, spec, summary, tests), "config": _config(run)},
    }
    return write_page(f"{spec.name}: a policy", "report", data)


def _player(
    tree: Any, spec: EnvSpec, tested: Episodes, seed: int, tell: Callable[[str], None]
) -> dict[str, Any]:
    chosen = _telling(tested.returns)
    seeds = [episode_seed(seed, episode) for episode in chosen.values()]
    (played,), fps = filmed([tree], spec, seeds, tell)
    titles = [
        f"{name}: return {format_return(episode['earned'][-1])} in {episode['length']:,} steps"
        + (
            ", cut there"
            if episode["end"] == "stopped" and episode["length"] != spec.max_episode_steps
            else ""
        )
        for name, episode in zip(chosen, played, strict=True)
    ]
    return {
        "drawing": drawing_of(spec),
        "fps": fps,
        "episodes": [episode | {"title": title} for episode, title in zip(played, titles, strict=True)],
    }


def _telling(returns: np.ndarray) -> dict[str, int]:
    """Choose the episodes to show: those at the ends and in the middle, or one where all earned the same."""
    order = np.argsort(returns, kind="stable")
    n = len(returns)
    if returns[order[0]] == returns[order[-1]]:
        return {f"Episode 1 of {n}" if n > 1 else "The episode": 0}
    chosen = {
        f"Median of {n}": int(order[n // 2]),
        f"Worst of {n}": int(order[0]),
        f"Best of {n}": int(order[-1]),
    }
    return {
        name: episode
        for i, (name, episode) in enumerate(chosen.items())
        if episode not in [*chosen.values()][:i]
    }


def _curve(run: Run) -> list[dict[str, Any]] | None:
    rows = run.metrics.read()
    series = [
        {
            "name": name,
            "points": [
                [row["time/total_timesteps"], round(row[column], 6)]
                for row in rows
                if math.isfinite(row[column])
            ],
        }
        for column, name in _CURVES.items()
    ]
    return [one for one in series if len(one["points"]) > 1] or None


def _provenance(run: Run, spec: EnvSpec, summary: dict[str, Any], tests: dict[str, Any]) -> list[list[str]]:
    about = run.metadata
    rows = [["environment", spec.name]]
    made_with = [*(f"{k}={v}" for k, v in spec.env_kwargs.items()), *(w.name for w in spec.wrappers)]
    rows += [["made with", ", ".join(made_with)]] if made_with else []
    rows += [["how", f"{k}: {v}"] for k, v in about["distilled"].items()]
    if not run.is_distilled:
        rows += [["training", f"{_algorithm(run)}, seed {run.seed}, preset {about['preset']}"]]
        rows += [["steps", f"{summary['timesteps']:,}"]] if "timesteps" in summary else []
        rows += [["seconds", f"{summary['training_seconds']:,.1f}"]] if "training_seconds" in summary else []
    rows += [
        ["test episodes", f"{len(tests['returns']):,} of seed {tests['seed']}, on Gymnasium, deterministic"]
    ]
    rows += [["run", str(run.path)]]
    versions = summary.get("versions", {"sympol": about["sympol"]})
    rows += [["versions", ", ".join(f"{name} {version}" for name, version in versions.items())]]
    return [[printable(name), printable(value)] for name, value in rows]


def _algorithm(run: Run) -> str:
    return run.config.algorithm.upper()


def _config(run: Run) -> str | None:
    return None if run.is_distilled else tomli_w.dumps(run.config.to_dict())
