"""Checkpoints: safetensors with a checksum beside it, written so that a kill at any moment loses nothing.

`save` writes the arrays, then a small JSON, the seal, that holds their SHA-256, each whole or not at all
(`sympol.files`). Without a seal that fits, a checkpoint does not exist; the one before is kept for that. Files of other
names are left alone. Nothing is ever unpickled. JAX is imported only where arrays are read or written.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .. import files
from ..bounded import parse_json

KEPT = 2
_MOST_GROWN = 1 << 28
"""The size, in bytes, up to which arrays that may have any length are read."""
_NAME = re.compile(r"[0-9]{12}")
_MOST_SEAL = 10_000
"""The size, in bytes, of the largest seal that is read, and room for what safetensors says of an array."""

State = TypeVar("State")


class CheckpointError(RuntimeError):
    """No usable checkpoint."""


class DamagedCheckpoint(UserWarning):
    """A checkpoint was truncated or edited, and the one before it is used."""


def save(folder: Path, state: Any, timestep: int) -> Path:
    """Write a checkpoint, and remove all earlier ones but the newest.

    Args:
        folder: The folder of the checkpoints, made if necessary.
        state: A pytree of arrays.
        timestep: The environment steps so far, by which checkpoints are ordered.

    Returns:
        The file with the arrays.

    Raises:
        OSError: It cannot be written.
    """
    from safetensors.numpy import save as save_tensors

    folder.mkdir(parents=True, exist_ok=True)
    tensors = {name: np.array(leaf, order="C") for name, leaf in _named_leaves(state)}
    content = save_tensors(tensors)
    path = folder / f"{timestep:012d}.safetensors"
    files.write(path, content)
    seal = {"timestep": timestep, "sha256": hashlib.sha256(content).hexdigest()}
    files.write(path.with_suffix(".json"), json.dumps(seal))
    for old in [old for old in _seals(folder) if int(old.stem) < timestep and _is_ours(old)][: -KEPT + 1]:
        _remove(old)
    return path


def has_checkpoints(folder: Path) -> bool:
    """Return whether any checkpoint was ever finished, be it damaged now."""
    return bool(_seals(folder))


def remove_all(folder: Path) -> None:
    """Remove all checkpoints, and the folder if nothing else is in it."""
    if folder.is_symlink() or not folder.is_dir():
        folder.unlink(missing_ok=True)
        return
    for file in folder.iterdir():
        if _NAME.fullmatch(file.stem) and file.suffix in (".json", ".safetensors"):
            file.unlink()
    with contextlib.suppress(OSError):
        folder.rmdir()


def load_latest(
    folder: Path, like: Callable[[int], State], obsolete: tuple[str, ...] = ()
) -> tuple[State, int]:
    """Read the newest checkpoint that is whole; truncated or edited ones are skipped with a warning.

    Args:
        folder: The folder of the checkpoints.
        like: From the environment steps of a checkpoint to a pytree of arrays, or of their shapes, of the form of its
            state. The first axis of an array that is empty may have any length in the file, and the array may be
            missing there.
        obsolete: How the names of arrays begin that a checkpoint may hold and that are not read.

    Returns:
        The state, and its environment steps.

    Raises:
        CheckpointError: None is whole.
    """
    from safetensors import SafetensorError

    problems = []
    for seal in reversed(_seals(folder)):
        try:
            state, timestep = _load(seal, like, obsolete)
        except (OSError, ValueError, KeyError, TypeError, SafetensorError) as error:
            problems.append(f"{seal.with_suffix('.safetensors').name}: {error}")
            continue
        if problems:
            message = f"damaged checkpoint skipped: {'; '.join(problems)}"
            warnings.warn(message, DamagedCheckpoint, stacklevel=2)
        return state, timestep
    detail = f": {'; '.join(problems)}" if problems else ""
    raise CheckpointError(f"no usable checkpoint in {folder}{detail}")


def _seals(folder: Path) -> list[Path]:
    """Return the seals of all checkpoints, oldest first; files of other names are not ours."""
    try:
        names = os.listdir(folder)
    except (FileNotFoundError, NotADirectoryError):
        return []
    return sorted(
        (folder / name for name in names if name.endswith(".json") and _NAME.fullmatch(name[:-5])),
        key=lambda seal: int(seal.stem),
    )


def _remove(seal: Path) -> None:
    """Remove a checkpoint, its seal last, so that a kill in between leaves what the next call removes."""
    seal.with_suffix(".safetensors").unlink(missing_ok=True)
    seal.unlink(missing_ok=True)


def _is_ours(seal: Path) -> bool:
    """Return whether a file is a checkpoint's seal, and not only named like one."""
    try:
        return _read_seal(seal)[0] == int(seal.stem)
    except (OSError, ValueError):
        return False


def _read_seal(path: Path) -> tuple[int, str]:
    seal = parse_json(files.read_text(path, _MOST_SEAL), "its checksum's file")
    if not isinstance(seal, dict):
        raise ValueError("its seal is not an object")
    timestep, checksum = seal.get("timestep"), seal.get("sha256")
    if type(timestep) is not int or timestep < 0 or not isinstance(checksum, str):
        raise ValueError("its seal lacks a timestep and a checksum")
    return timestep, checksum


def _load(seal_path: Path, form: Callable[[int], State], obsolete: tuple[str, ...]) -> tuple[State, int]:
    import jax
    from safetensors.numpy import load as load_tensors

    timestep, checksum = _read_seal(seal_path)
    like = form(timestep)
    named = jax.tree_util.tree_flatten_with_path(like)[0]  # arrays, or only their shapes
    most = _MOST_SEAL + sum(int(leaf.size) * leaf.dtype.itemsize + _MOST_SEAL for _, leaf in named)
    most += _MOST_GROWN if any(_grows(leaf) for _, leaf in named) else 0
    content = files.read_bytes(seal_path.with_suffix(".safetensors"), most)
    if hashlib.sha256(content).hexdigest() != checksum:
        raise ValueError("its checksum does not match: truncated or edited")
    tensors = load_tensors(content)
    leaves = []
    for path, leaf in named:
        name = jax.tree_util.keystr(path)
        saved = tensors.pop(name, leaf) if _grows(leaf) else tensors.pop(name)
        shape = (len(saved), *leaf.shape[1:]) if _grows(leaf) and saved.ndim else leaf.shape
        if saved.shape != shape or saved.dtype != leaf.dtype:
            raise ValueError(f"{name} is {saved.dtype}{saved.shape}, expected {leaf.dtype}{leaf.shape}")
        leaves.append(saved)
    if unexpected := [name for name in sorted(tensors) if not name.startswith(obsolete)]:
        raise ValueError(f"unexpected arrays {unexpected}")
    return jax.tree.unflatten(jax.tree.structure(like), leaves), timestep


def _grows(leaf: Any) -> bool:
    """Return whether an array may have another length in a file."""
    return bool(leaf.shape) and leaf.shape[0] == 0


def _named_leaves(state: Any) -> list[tuple[str, np.ndarray]]:
    import jax

    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return [(jax.tree_util.keystr(path), _on_host(leaf)) for path, leaf in leaves]


def _on_host(leaf: Any) -> np.ndarray:
    """Return a whole array; parts on other processes are fetched, so that each of them must be saving, too."""
    import jax

    if isinstance(leaf, jax.Array) and not (leaf.is_fully_addressable or leaf.is_fully_replicated):
        from jax.experimental import multihost_utils

        leaf = multihost_utils.process_allgather(leaf, tiled=True)
    return np.asarray(leaf)
