"""The arguments of ``sympol train`` about the tree it starts from."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ..algorithms.warm_start import Start, start_of
from ..envs.spec import EnvSpec
from ..runs.metadata import CONFIG, RunError
from ..runs.run import Run
from .train import Train
from .tree_io import tree_from


def start_from(given: Train, spec: EnvSpec) -> Start | None:
    """Return the tree that ``--start`` names, and how to start from it, or None without ``--start``.

    Args:
        given: The arguments of the command.
        spec: The environment.

    Raises:
        RunError: There is no tree.
        ValueError: A flag needs ``--start`` or does not fit the tree, or the tree does not fit the environment.
    """
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
