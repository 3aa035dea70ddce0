"""Checkpoints: safetensors with a checksum beside it, written so that a kill at any moment loses nothing.

`save` writes the arrays, then a small JSON that holds their SHA-256, each to a temporary name first. Without a
JSON that fits, a checkpoint does not exist; the one before is kept for that. Nothing is ever unpickled.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np
from jax.experimental import multihost_utils
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

KEPT = 2

State = TypeVar("State")


class CheckpointError(RuntimeError):
    """No usable checkpoint."""


class DamagedCheckpoint(UserWarning):
    """A checkpoint was truncated or edited, and the one before it is used."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that is either the old one or the whole new one, whatever happens."""
    temporary = path.with_name(f".{path.name}.tmp")
    with open(temporary, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


def save(folder: Path, state: Any, timestep: int) -> Path:
    """Write a checkpoint and forget all but the newest two."""
    folder.mkdir(parents=True, exist_ok=True)
    tensors = {name: np.array(leaf, order="C") for name, leaf in _named_leaves(state)}
    content = save_tensors(tensors)
    path = folder / f"{timestep:012d}.safetensors"
    write_atomically(path, content)
    seal = {"timestep": timestep, "sha256": hashlib.sha256(content).hexdigest()}
    write_atomically(path.with_suffix(".json"), json.dumps(seal).encode())
    for old in sorted(folder.glob("*.json"))[:-KEPT]:
        old.unlink()
        old.with_suffix(".safetensors").unlink(missing_ok=True)
    return path


def has_checkpoints(folder: Path) -> bool:
    """Whether any was ever finished, be it damaged now."""
    return any(folder.glob("*.json"))


def load_latest(folder: Path, like: State) -> tuple[State, int]:
    """The newest checkpoint that is whole, in the shape of ``like``, and its timestep.

    A truncated or edited one is passed over with a warning. Raises CheckpointError if none is left.
    """
    problems = []
    for seal in sorted(folder.glob("*.json"), reverse=True):
        try:
            state, timestep = _load(seal, like)
        except (OSError, ValueError, KeyError, TypeError, SafetensorError) as error:
            problems.append(f"{seal.with_suffix('.safetensors').name}: {error}")
            continue
        if problems:
            message = f"damaged checkpoint passed over: {'; '.join(problems)}"
            warnings.warn(message, DamagedCheckpoint, stacklevel=2)
        return state, timestep
    detail = f": {'; '.join(problems)}" if problems else ""
    raise CheckpointError(f"no usable checkpoint in {folder}{detail}")


def _load(seal_path: Path, like: State) -> tuple[State, int]:
    seal = json.loads(seal_path.read_text())
    content = seal_path.with_suffix(".safetensors").read_bytes()
    if hashlib.sha256(content).hexdigest() != seal["sha256"]:
        raise ValueError("its checksum does not match: truncated or edited")
    tensors = load_tensors(content)
    leaves = []
    for path, leaf in jax.tree_util.tree_flatten_with_path(like)[0]:  # arrays, or only their shapes
        name = jax.tree_util.keystr(path)
        saved = tensors.pop(name)
        if saved.shape != leaf.shape or saved.dtype != leaf.dtype:
            raise ValueError(f"{name} is {saved.dtype}{saved.shape}, expected {leaf.dtype}{leaf.shape}")
        leaves.append(saved)
    if tensors:
        raise ValueError(f"unexpected arrays {sorted(tensors)}")
    return jax.tree.unflatten(jax.tree.structure(like), leaves), int(seal["timestep"])


def _named_leaves(state: Any) -> list[tuple[str, np.ndarray]]:
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return [(jax.tree_util.keystr(path), _on_host(leaf)) for path, leaf in leaves]


def _on_host(leaf: Any) -> np.ndarray:
    """All of an array; what lies with other processes is fetched, so that each of them must be saving, too."""
    if isinstance(leaf, jax.Array) and not (leaf.is_fully_addressable or leaf.is_fully_replicated):
        leaf = multihost_utils.process_allgather(leaf, tiled=True)
    return np.asarray(leaf)
