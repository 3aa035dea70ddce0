"""The compiled training program, kept on disk: the second run starts at once."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Self

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


class CompileClock:
    """Counts compilations and the seconds they took, tracing and lowering included, while it is entered."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.count = 0

    def __enter__(self) -> Self:
        """Start counting."""
        jax.monitoring.register_event_duration_secs_listener(self._listen)
        return self

    def __exit__(self, *error: object) -> None:
        """Stop counting."""
        jax.monitoring.unregister_event_duration_listener(self._listen)

    def _listen(self, event: str, seconds: float, **_: object) -> None:
        if event.startswith("/jax/core/compile/"):
            self.seconds += seconds
            self.count += event.endswith("backend_compile_duration")
