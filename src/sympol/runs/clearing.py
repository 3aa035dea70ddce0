"""Check that a run may be made in a folder, and remove what an earlier run left there."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from .. import files
from .checkpoint import has_checkpoints, remove_all
from .lock import LOCK, writer_of
from .metadata import CONFIG, RunError, is_run

START = "start.json"
FORMS = ("policy.json", "policy.py", "tree.txt", "tree.svg")
"""The files of a run that hold its tree."""
_MADE = ("metrics.csv", *FORMS, "summary.json", "episode.gif", "report.html")


def require_free(path: Path, *, overwrite: bool, distilled: bool = False, flag: str | None = None) -> None:
    """Refuse a path where no run can be made.

    Args:
        path: The folder of the new run.
        overwrite: Whether a run that is there may be replaced.
        distilled: Whether the new run is a distilled tree, which is not resumed but made again.
        flag: The flag that chooses the folder, for messages; by default that of the command that makes such a run.

    Raises:
        RunError: It is a file, another program's folder, a folder that another process writes in, or a run that must
            not be replaced.
    """
    flag = flag or folder_flag(distilled=distilled)
    if path.exists() and not path.is_dir():
        raise RunError(f"{path} is a file; choose another {flag}")
    for folder in (path, *(path / "distilled").glob("*")):
        if (writer := writer_of(folder)) is not None:
            raise written_by(writer, folder, flag)
    if path.is_dir() and not _is_unused(path):
        if not is_run(path / "config.toml"):
            raise RunError(f"{path} exists and is not a sympol run; choose another {flag}")
        if not overwrite:
            resume = "" if distilled else f"continue it with `sympol resume {path}`, "
            raise RunError(
                f"{path} already holds a run; {resume}replace it with --overwrite, or choose another {flag}"
            )
        for name in (*_MADE, CONFIG, START):
            if (path / name).is_dir() and not (path / name).is_symlink():
                raise RunError(
                    f"{path / name} is a folder, and a file of the run belongs there; move it away, or choose another "
                    f"{flag}"
                )


def _is_unused(path: Path) -> bool:
    """Return whether a folder is empty, or holds only what a process left that died before it wrote the config."""
    names = set(os.listdir(path))
    unfinished = {name for name in names if name == LOCK or files.is_temporary(name)}
    rest = names - unfinished
    if LOCK in names:  # only a run's folder has one: the other files were there when a run was replaced
        return not rest & {CONFIG, *_MADE} and not has_checkpoints(path / "checkpoints")
    return not rest or (bool(unfinished) and rest == {START})


def clear(path: Path) -> None:
    """Remove a run's files, and leave all others in its folders.

    The config goes last: a process killed meanwhile leaves a run without results, or an unused folder.

    Args:
        path: The run's folder, which stays.

    Raises:
        OSError: A file cannot be removed.
    """
    remove_all(path / "checkpoints")
    for folder, pattern in ((path / "distilled", "*"), (path / "tensorboard", "events.out.tfevents.*")):
        if folder.is_symlink():
            folder.unlink()
            continue
        for made in folder.glob(pattern):
            if not made.is_dir():
                made.unlink()
            elif not made.is_symlink() and is_run(made / CONFIG):
                clear(made)
                _remove_if_empty(made)
        _remove_if_empty(folder)
    for name in (*_MADE, CONFIG, START):
        (path / name).unlink(missing_ok=True)


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def folder_flag(*, distilled: bool) -> str:
    """Return the flag that chooses the folder of a run: ``--out`` for distilled trees, ``--run-dir`` for trainings."""
    return "--out" if distilled else "--run-dir"


def written_by(writer: str, path: Path, flag: str | None) -> RunError:
    """Return the error for a folder that another process writes in.

    Args:
        writer: The process, such as ``"process 12 on host"``.
        path: The folder.
        flag: The flag that chooses another folder, if there is one.
    """
    another = "" if flag is None else f", or choose another {flag}"
    return RunError(f"{path} is being written by {writer}; wait until it has ended{another}")
