"""For all tests: JAX on the CPU, accidents of dtype and shape as errors, compiled programs kept on disk."""

from __future__ import annotations

import os
import signal
from pathlib import Path

os.environ["JAX_PLATFORMS"] = "cpu"

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # begun in the background of a script, as CI may be
    signal.signal(signal.SIGINT, signal.default_int_handler)  # or what tests interrupt would never hear of it

import jax

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    cache = Path(__file__).resolve().parents[1] / ".pytest_cache" / "xla"
    jax.config.update("jax_compilation_cache_dir", str(cache))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
