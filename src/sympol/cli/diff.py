"""``sympol diff``: how two trees differ."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..runs.metadata import RunError
from ..trees import DecisionTree
from ..trees.diff import diff
from .arguments import Folder, PlaysRun, parse
from .console import out
from .tree_io import spec_from, tree_from

if TYPE_CHECKING:
    from ..envs.spec import EnvSpec

MOST_LINES = 30


@dataclass
class Diff(PlaysRun):
    """List how a tree was changed, and how many of the states it visits get another action."""

    before: Folder
    """A run's folder, a policy.json, or a listing in a .txt."""

    after: Folder
    """Another tree of the same features and actions."""

    episodes: int = 0
    """Number of test episodes to play with the first tree, in whose states actions are compared."""

    seed: int = 7
    """Seed of the episodes, which are those of sympol eval."""

    json: bool = False
    """Print one line of JSON."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol diff``."""
    given = parse(Diff, "diff", words)
    if given.episodes < 0:
        raise ValueError(f"--episodes must not be negative, got {given.episodes}")
    before, after = tree_from(given.before), tree_from(given.after)
    seen = None
    if given.episodes:
        from ..play import play

        seen = play(before, _spec(given, before), given.episodes, seed=given.seed).observations
    found = diff(before, after, seen)
    if given.json:
        print(json.dumps(found.to_dict(), allow_nan=False))
        return 0
    out.print(f"{before.n_nodes} nodes, then {after.n_nodes}")
    for change in found.changes[:MOST_LINES]:
        out.print(change.words, markup=False)
    if (more := len(found.changes) - MOST_LINES) > 0:
        out.print(f"… and {more:,} more changes; all of them: --json")
    for sentence in found.sentences[len(found.changes) :]:
        out.print(sentence, markup=False)
    return 0


def _spec(given: Diff, tree: DecisionTree) -> EnvSpec:
    """Return the environment of either tree: the file of an edited tree may not name it."""
    try:
        return spec_from(given.before, tree, given)
    except RunError:
        with contextlib.suppress(RunError):
            return spec_from(given.after, tree, given)
        raise
