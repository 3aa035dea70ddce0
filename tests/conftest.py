"""For all tests: JAX on the CPU, accidents of dtype and shape as errors, compiled programs kept on disk."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

os.environ["JAX_PLATFORMS"] = "cpu"

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # begun in the background of a script, as CI may be
    signal.signal(signal.SIGINT, signal.default_int_handler)  # or what tests interrupt would never hear of it

import jax
import pytest

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    cache = Path(__file__).resolve().parents[1] / ".pytest_cache" / "xla"
    jax.config.update("jax_compilation_cache_dir", str(cache))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)

GOLDEN = Path(__file__).parent / "golden"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden", action="store_true", help="rewrite tests/golden instead of comparing with it"
    )


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Compare a text with a file of tests/golden, to the byte; ``--update-golden`` writes the file instead."""

    def compare(name: str, text: str) -> None:
        file = GOLDEN / name
        if request.config.getoption("--update-golden"):
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(text.encode())
        else:
            assert text == file.read_bytes().decode(), f"not as in {file}; if that is meant: --update-golden"

    return compare
