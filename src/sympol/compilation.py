"""Compiled programs, kept on disk: the second run starts at once."""

from __future__ import annotations

import os
from pathlib import Path

import jax


def cache_folder() -> Path | None:
    """``$SYMPOL_CACHE_DIR`` or ``~/.cache/sympol``; None where that variable is empty, and nothing is kept."""
    folder = os.environ.get("SYMPOL_CACHE_DIR", str(Path.home() / ".cache" / "sympol"))
    return Path(folder) if folder else None


def use_disk_cache() -> None:
    """Keep JAX's programs in the `cache_folder`, unless JAX has its own place."""
    folder = cache_folder()
    if folder is None or jax.config.jax_compilation_cache_dir is not None:  # pyright: ignore[reportAttributeAccessIssue]
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
