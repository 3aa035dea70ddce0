"""The command that tells two trees apart, diff."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass

from ..envs.spec import EnvSpec
from ..play import play
from ..runs.metadata import RunError
from ..trees import DecisionTree
from ..trees.diff import diff as tell_apart
from .arguments import Folder, PlaysRun
from .console import one_line_errors, out
from .parse import parse
from .tree_io import spec_from, tree_from

MOST_LINES = 30


@dataclass
class Diff(PlaysRun):
    """What became of a tree, in words, and how many of the states it visits get another action."""

    before: Folder
    """A run's folder, a policy.json, or a listing in a .txt."""

    after: Folder
    """Another one, of the same features and actions."""

    episodes: int = 0
    """Play so many test episodes with the first one, and count in the states it visits."""

    seed: int = 7
    """Another seed, other episodes; they are those of sympol eval."""

    json: bool = False
    """One line of JSON."""


@one_line_errors()
def diff(arguments: Sequence[str]) -> int:
    """``sympol diff``."""
    given = parse(Diff, "diff", arguments)
    if given.episodes < 0:
        raise ValueError(f"--episodes must not be negative, got {given.episodes}")
    before, after = tree_from(given.before), tree_from(given.after)
    seen = None
    if given.episodes:
        seen = play(before, _spec(given, before), given.episodes, seed=given.seed).observations
    found = tell_apart(before, after, seen)
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
    """Where both act: an edited tree may be a file that does not say."""
    try:
        return spec_from(given.before, tree, given)
    except RunError:
        with contextlib.suppress(RunError):
            return spec_from(given.after, tree, given)
        raise
