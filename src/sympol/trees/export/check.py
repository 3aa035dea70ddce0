"""What is exported, tried: compile and run it here, on observations that can tell it from its tree.

Compilers and interpreters are programs of the machine; one that is missing is named with its package.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..base import BaseTree
from . import c, rust
from . import check_mains as mains
from .common import Answers, answers
from .javascript import to_javascript
from .onnx import to_onnx
from .python import to_python
from .sql import to_sql
from .treelite import to_treelite

if TYPE_CHECKING:
    from jaxtyping import Float32

STRICT_C = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
STRICT_RUST = ("--edition", "2021", "-D", "warnings")
TIMEOUT = 600
"""Seconds a compiler or a program may take."""


@final
@dataclass(frozen=True)
class Ran:
    """What a program answered, and the seconds of each round through all observations."""

    actions: np.ndarray
    seconds: tuple[float, ...] = ()


def trial_observations(tree: BaseTree, n: int, seed: int = 0) -> Float32[np.ndarray, "n features"]:
    """Draw observations that the tree accepts: on thresholds and bounds, beside them, anywhere, infinite, NaN, tiny."""
    rng = np.random.default_rng(seed)
    tiny = np.array([0.0, -0.0, 1e-40, -1e-40, 2.0**-126, -(2.0**-126)], np.float32)
    special = np.concatenate([tiny, np.array([np.inf, -np.inf, np.nan, 3e38, -3e38], np.float32)])
    at = np.concatenate([tree.threshold[~tree.is_leaf], tree.feature_low, tree.feature_high])
    up, down = (np.nextafter(at, np.float32(end)) for end in (np.inf, -np.inf))
    x = rng.choice(np.concatenate([at, up, down, special]), (n, tree.n_features))
    anywhere = rng.normal(size=x.shape) * rng.choice([0.1, 1, 10], x.shape)
    x = np.where(rng.random(x.shape) < 0.3, anywhere, x).astype(np.float32)
    for feature in range(tree.n_features):  # a number meets most at the thresholds of its own feature
        own = tree.threshold[tree.feature == feature]
        if own.size:
            exact = rng.choice(own, n)
            beside = np.nextafter(exact, rng.choice(np.array([-np.inf, np.inf], np.float32), n))
            drawn = rng.random(n)
            x[:, feature] = np.where(drawn < 0.2, exact, np.where(drawn < 0.4, beside, x[:, feature]))
    for group in tree.groups:
        x[:, group.features] = np.eye(len(group.features))[rng.integers(len(group.features), size=n)]
    return x


def run(
    tree: BaseTree, to: str, x: Float32[np.ndarray, "batch features"], *, rounds: int = 1, **options: Any
) -> Ran:
    """Export the tree, compile it, run it on observations; its actions are flat, [batch, outputs].

    Args:
        tree: What is exported.
        to: One of `RUNS`.
        x: Observations.
        rounds: How often the program goes through them, each round timed by itself.
        options: Of the export.

    Raises:
        FileNotFoundError: if a compiler or an interpreter is missing, naming its package.
        ImportError: if a library is.
        RuntimeError: if the program does not compile or run.
        ValueError: if there is no such program, or the tree has no features.
    """
    if to not in RUNS:
        raise ValueError(f"what is exported to {to} cannot be tried here; {', '.join(RUNS)} can")
    if not tree.n_features:
        raise ValueError("a tree without features cannot be tried: its observations are empty")
    rows = answers(tree)
    ran = RUNS[to](tree, rows, np.ascontiguousarray(x, np.float32), rounds, **options)
    return Ran(np.asarray(ran.actions).reshape(len(x), rows.n_outputs), ran.seconds)


def expected(tree: BaseTree, x: Float32[np.ndarray, "batch features"]) -> np.ndarray:
    """What the tree does, as `run` has it: flat, [batch, outputs]."""
    return tree.predict(x).reshape(len(x), -1)


def program(name: str, package: str) -> str:
    """Where a program is. Raises FileNotFoundError, naming the distribution's package, where it is not."""
    found = shutil.which(name)
    if found is None:
        raise FileNotFoundError(
            f"{name} is not on this machine; install the distribution's package {package}"
        )
    return found


def call(command: Sequence[str], folder: Path, given: bytes = b"") -> tuple[bytes, str]:
    """Run a program; return what it wrote and what it said. Raises RuntimeError with its words where it failed."""
    try:
        done = subprocess.run(
            command, cwd=folder, input=given, capture_output=True, timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise RuntimeError(f"{Path(command[0]).name} did not end in {TIMEOUT} seconds") from error
    said = done.stderr.decode("utf-8", "replace")
    if done.returncode:
        raise RuntimeError(
            f"{Path(command[0]).name} failed with status {done.returncode}: {said.strip()[:2000]}"
        )
    return done.stdout, said


_DTYPES = {"float": np.float32, "int32_t": np.int32, "int64_t": np.int64}
_DTYPES |= {"f32": np.float32, "i32": np.int32, "i64": np.int64}


def _build_and_run(
    files: Mapping[str, str],
    build: Sequence[str],
    start: Sequence[str],
    x: np.ndarray,
    rounds: int,
    dtype: Any,
) -> Ran:
    with tempfile.TemporaryDirectory(prefix="sympol-trial-") as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        if build:
            call(build, folder)
        written, said = call([*start, str(len(x)), str(rounds)], folder, x.tobytes())
    return Ran(np.frombuffer(written, dtype), tuple(map(float, said.split())))


def _c(tree: BaseTree, rows: Answers, x: np.ndarray, rounds: int, **options: Any) -> Ran:
    kind = c.answer_type(rows)
    main = mains.c(tree.n_features, rows.n_outputs, kind, rows.single)
    files = {"policy.c": c.to_c(tree, **options), "main.c": main}
    build = [program("cc", "gcc"), *STRICT_C, "-O2", "main.c", "-o", "main"]
    return _build_and_run(files, build, ["./main"], x, rounds, _DTYPES[kind])


def _rust(tree: BaseTree, rows: Answers, x: np.ndarray, rounds: int, **options: Any) -> Ran:
    files = {"policy.rs": rust.to_rust(tree, **options), "main.rs": mains.rust(tree.n_features, rows.single)}
    build = [program("rustc", "rustc"), *STRICT_RUST, "-O", "main.rs"]
    return _build_and_run(files, build, ["./main"], x, rounds, _DTYPES[rust.answer_type(rows)])


def _javascript(tree: BaseTree, rows: Answers, x: np.ndarray, rounds: int, **options: Any) -> Ran:
    main = mains.javascript(tree.n_features, rows.is_float)
    files = {"policy.mjs": to_javascript(tree, **options), "main.mjs": main}
    return _build_and_run(files, [], [program("node", "nodejs"), "main.mjs"], x, rounds, rows.rows.dtype)


def _python(tree: BaseTree, rows: Answers, x: np.ndarray, rounds: int, **options: Any) -> Ran:
    namespace: dict[str, Any] = {"__name__": "policy"}
    exec(compile(to_python(tree, **options), "policy.py", "exec"), namespace)
    act, lists, seconds = namespace["act"], x.tolist(), []
    done: list[Any] = []
    for _ in range(rounds):
        start = time.perf_counter()
        done = [act(row) for row in lists]
        seconds.append(time.perf_counter() - start)
    return Ran(np.array(done, rows.rows.dtype), tuple(seconds))


def _sql(tree: BaseTree, rows: Answers, x: np.ndarray, rounds: int, **options: Any) -> Ran:
    n = tree.n_features
    query = to_sql(tree, **{"style": "sqlite", **options, "columns": [f"f{i}" for i in range(n)]})
    seconds, done = [], []
    with contextlib.closing(sqlite3.connect(":memory:")) as database:
        database.execute(f"CREATE TABLE observations ({', '.join(f'f{i} REAL' for i in range(n))})")
        database.executemany(f"INSERT INTO observations VALUES ({', '.join('?' * n)})", x.tolist())
        for _ in range(rounds):
            start = time.perf_counter()
            done = database.execute(query).fetchall()
            seconds.append(time.perf_counter() - start)
    return Ran(np.array([row[n:] for row in done], rows.rows.dtype), tuple(seconds))


def _onnx(tree: BaseTree, rows: Answers, x: np.ndarray, rounds: int, **options: Any) -> Ran:
    try:
        import onnxruntime
    except ImportError as error:
        raise ImportError("trying an ONNX model needs onnxruntime: pip install onnxruntime") from error
    session = onnxruntime.InferenceSession(to_onnx(tree, **options), providers=["CPUExecutionProvider"])
    seconds: list[float] = []
    done: Any = ()
    for _ in range(rounds):
        start = time.perf_counter()
        done = session.run(None, {"observation": x})[0]
        seconds.append(time.perf_counter() - start)
    return Ran(done, tuple(seconds))


def _treelite(tree: BaseTree, rows: Answers, x: np.ndarray, rounds: int, **options: Any) -> Ran:
    written = to_treelite(tree, **options)
    import treelite

    model = treelite.Model.deserialize_bytes(written)
    seconds, done = [], np.empty(0)
    for _ in range(rounds):
        start = time.perf_counter()
        done = treelite.gtil.predict(model, x)
        seconds.append(time.perf_counter() - start)
    return Ran(done.astype(rows.rows.dtype), tuple(seconds))


RUNS: Mapping[str, Callable[..., Ran]] = {
    "python": _python,
    "c": _c,
    "rust": _rust,
    "javascript": _javascript,
    "sql": _sql,
    "onnx": _onnx,
    "treelite": _treelite,
}
"""What can be compiled and run here, by its name in `FORMATS`."""
