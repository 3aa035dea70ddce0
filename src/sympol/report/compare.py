"""Several runs of one environment in one page: the same episodes side by side, returns on one axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax

from ..agents import Agent
from ..envs.spec import EnvSpec
from ..play import episode_seed, play
from ..runs.metadata import RunError
from ..runs.run import Run
from ..trees import DecisionTree
from ..trees.floats import printable
from ..trees.report import policy_data, write_page
from .data import check_test, policy_of, tests_data
from .episodes import drawing_of, filmed

MOST = 6
"""The largest number of policies side by side."""
FILMED = 2
"""Number of test episodes, the first ones, that can be watched."""
_KINDS = {"mlp": "neural network", "sdt": "soft tree", "tree": "decision tree"}


def compare(
    runs: Sequence[Run],
    *,
    episodes: int = 100,
    seed: int = 7,
    progress: Callable[[str], None] | None = None,
) -> str:
    """Write the page of several runs, trees or not, on the same test episodes.

    Args:
        runs: The runs, 2 to `MOST`, of one environment.
        episodes: Number of test episodes.
        seed: Seed of the episodes.
        progress: Called with a line of text about what is being done.

    Returns:
        The page, as HTML.

    Raises:
        RunError: They are of different environments, or one cannot be read.
        ValueError: There are too few or too many runs, an argument is out of bounds, or Gymnasium lacks the
            environment.
    """
    check_test(episodes, seed)
    if not 2 <= len(runs) <= MOST:
        raise ValueError(f"between 2 and {MOST} runs can be compared, got {len(runs)}")
    _require_one_environment(runs)
    tell = progress or (lambda words: None)
    spec = runs[0].resolve_env()
    policies = [policy_of(run) for run in runs]
    names = _names(runs)
    shown = []
    for run, policy, name in zip(runs, policies, names, strict=True):
        tell(f"{name}: playing {episodes} test episodes")
        shown.append(_described(run, policy, name, spec, episodes, seed))
    seeds = [episode_seed(seed, episode) for episode in range(min(FILMED, episodes))]
    films, fps = filmed(policies, spec, seeds, tell)
    for one, played in zip(shown, films, strict=True):
        one["episodes"] = played
    data = {
        "title": printable(spec.name),
        "kicker": f"{len(runs)} policies compared",
        "facts": [[f"{episodes:,}", "test episodes, the same for all"]],
        "policies": shown,
        "columns": len(spec.features.names),
        "player": {
            "drawing": drawing_of(spec),
            "fps": fps,
            "titles": [f"Episode {i + 1} of {episodes}" for i in range(len(seeds))],
        },
    }
    return write_page(f"{spec.name}: {len(runs)} policies", "compare", data)


def _require_one_environment(runs: Sequence[Run]) -> None:
    parts = ("env", "env_kwargs", "wrappers", "not_kept")
    first, *others = [tuple(run.metadata[part] for part in parts) for run in runs]
    for run, other in zip(runs[1:], others, strict=True):
        if other != first:
            raise RunError(
                f"{runs[0].path} is of {_made(*first)}, {run.path} of {_made(*other)}: only policies of one "
                "environment can play the same episodes"
            )


def _made(env: str, kwargs: dict[str, Any], wrappers: list[dict[str, Any]], not_kept: str) -> str:
    around = [f"in {wrapper['name']}" for wrapper in wrappers]
    said = [env, *(f"{name}={value}" for name, value in kwargs.items()), *around, not_kept]
    return " ".join(part for part in said if part)


def _names(runs: Sequence[Run]) -> list[str]:
    """Call runs by their folders, or by their whole paths where folders have one name."""
    short = [run.path.name for run in runs]
    alike = len(set(short)) < len(short)
    return [printable(str(run.path) if alike else name) for run, name in zip(runs, short, strict=True)]


def _described(
    run: Run, policy: Agent | DecisionTree, name: str, spec: EnvSpec, episodes: int, seed: int
) -> dict[str, Any]:
    tested = play(policy, spec, episodes, seed=seed)
    tests = tests_data(tested, seed)
    tree = policy.with_visits(tested.observations) if isinstance(policy, DecisionTree) else None
    return {
        "name": name,
        "kind": _KINDS["tree" if run.is_distilled else run.config.policy]
        + (" (distilled)" if run.is_distilled else f" ({run.config.algorithm.upper()})"),
        "tests": tests,
        "size": _size(policy),
        "policy": None if tree is None else policy_data(tree, tested.observations),
    }


def _size(policy: Agent | DecisionTree) -> dict[str, int | None]:
    """Say how large a policy is: in nodes, or in the numbers that a network multiplies."""
    if isinstance(policy, DecisionTree):
        return {"nodes": policy.n_nodes, "depth": policy.depth, "parameters": None}
    parameters = sum(leaf.size for leaf in jax.tree.leaves(policy.actor) if hasattr(leaf, "size"))
    return {"nodes": None, "depth": None, "parameters": int(parameters)}
