"""Messages between the tasks of a search: requests, results, and what each saves in its folder for the others.

Each message is a dataclass that `sympol.results.records` writes and reads, so both sides have the same schema.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from ... import files
from ...bounded import parse_json
from ...results.records import from_fields, to_fields
from ...trees import DecisionTree
from ..budget import Budget, Cost
from .config import SearchConfig
from .front import current_method

CANDIDATES = "candidates.json"
"""The file of a task's candidates."""
PROGRESS = "progress.json"
"""The file of an evolution's progress, for the live display."""
FORMER_CANDIDATES = "found.json"
"""The name of the first of them in folders of earlier versions."""


@dataclass(frozen=True)
class TaskRequest:
    """One task of a search: what any process needs to know in order to do it."""

    config: SearchConfig
    folder: Path
    """The folder of the whole search."""
    method: str
    index: int
    """The number of the task among those of its method, from 0."""
    budget: Budget

    @property
    def task_folder(self) -> Path:
        """The folder of this task."""
        return task_folder(self.folder, self.method, self.index)


@dataclass(frozen=True)
class TaskResult:
    """The answer of a task; its candidates are in its folder."""

    warnings: tuple[str, ...]
    """Warnings that were raised, each once."""


@dataclass(frozen=True)
class Candidate:
    """A tree, the methods that made it, and its cost."""

    FORMER_NAMES: ClassVar[Mapping[str, str]] = {"road": "method", "spent": "cost"}

    tree: DecisionTree
    method: str
    cost: Cost


@dataclass(frozen=True)
class SavedCandidates:
    """The candidates that a task has saved, and whether it is finished."""

    FORMER_NAMES: ClassVar[Mapping[str, str]] = {"found": "candidates"}

    finished: bool
    candidates: tuple[Candidate, ...]


@dataclass(frozen=True)
class EvolutionProgress:
    """The progress of an evolution."""

    best: Mapping[int, float]
    """The best mean return so far of each number of nodes."""


def task_folder(folder: Path, method: str, index: int) -> Path:
    """Return the folder of a task.

    Args:
        folder: The folder of the whole search.
        method: The method of the task.
        index: The number of the task among those of its method.

    Returns:
        A folder below ``folder``.
    """
    return folder / method / str(index)


def save_candidates(folder: Path, candidates: Iterable[Candidate], *, finished: bool) -> None:
    """Write the candidates that a task has so far.

    Args:
        folder: The folder of the task; it is made where it is missing.
        candidates: All of them; they replace those that were saved before.
        finished: Whether the task has no more to do.
    """
    folder.mkdir(parents=True, exist_ok=True)
    content = to_fields(SavedCandidates(finished, tuple(candidates)))
    files.write(folder / CANDIDATES, json.dumps(content))


def load_candidates(folder: Path) -> SavedCandidates:
    """Read the candidates of a task.

    Args:
        folder: The folder of the task.

    Returns:
        Its candidates; none, and not finished, where nothing has been saved.

    Raises:
        ValueError: The file is damaged.
    """
    file = next((folder / name for name in (CANDIDATES, FORMER_CANDIDATES) if (folder / name).exists()), None)
    if file is None:
        return SavedCandidates(False, ())
    try:
        saved = from_fields(SavedCandidates, parse_json(files.read_text(file), "it"))
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise ValueError(f"{file} cannot be read ({error}); remove {folder} and search again") from error
    current = (replace(one, method=current_method(one.method)) for one in saved.candidates)
    return replace(saved, candidates=tuple(current))


def save_progress(folder: Path, best: Mapping[int, float]) -> None:
    """Write the progress of an evolution.

    Args:
        folder: The folder of its task.
        best: The best mean return so far of each number of nodes.
    """
    files.write(folder / PROGRESS, json.dumps(to_fields(EvolutionProgress(best))))


def load_progress(folder: Path) -> EvolutionProgress:
    """Read the progress of an evolution.

    Args:
        folder: The folder of its task.

    Returns:
        Its progress; empty where there is none, or while it is being written.
    """
    try:
        return from_fields(EvolutionProgress, parse_json(files.read_text(folder / PROGRESS), "it"))
    except (OSError, ValueError):
        return EvolutionProgress({})
