"""The compiled training program, kept on disk: the second run starts at once."""

from __future__ import annotations

import os
from pathlib import Path

import jax


def use_disk_cache() -> None:
    """Keep compiled programs in ``$SYMPOL_CACHE_DIR`` or ``~/.cache/sympol``, unless JAX has its own place.

    An empty ``SYMPOL_CACHE_DIR`` keeps none.
    """
    if jax.config.jax_compilation_cache_dir is not None:  # pyright: ignore[reportAttributeAccessIssue]
        return
    folder = os.environ.get("SYMPOL_CACHE_DIR", str(Path.home() / ".cache" / "sympol"))
    if folder:
        jax.config.update("jax_compilation_cache_dir", folder)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
