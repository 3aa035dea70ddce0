"""What a training on the command line starts from."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ..algorithms.warm_start import Start, start_of
from ..envs.spec import EnvSpec
from ..runs.metadata import CONFIG, RunError
from ..runs.run import Run
from .arguments import Train
from .tree_io import tree_from


def start_from(given: Train, spec: EnvSpec) -> Start | None:
    """The tree that ``--start`` names, and how to train on from it in an environment.

    Raises:
        RunError: there is no tree.
        ValueError: flags that need ``--start``, or that do not fit the tree; or a tree for something else.
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
    """What the tree earned in its test episodes, if it is a finished run's."""
    folder = path if path.is_dir() else path.parent
    if not (folder / CONFIG).is_file() or (path.is_file() and path.name != "policy.json"):
        return None
    with contextlib.suppress(RunError):
        value = (Run.open(folder).load_summary() or {}).get("return_mean")
        return float(value) if isinstance(value, int | float) else None
    return None
