"""What every benchmark needs: fair timing on a shared machine, the machine's own limits, results as JSON."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import jax

ROOT = Path(__file__).resolve().parents[2]


def arguments_of(document: str | None) -> argparse.ArgumentParser:
    """Return the parser of a benchmark's arguments, whose help is the benchmark's docstring."""
    return argparse.ArgumentParser(description=document, formatter_class=argparse.RawDescriptionHelpFormatter)


class Timing(NamedTuple):
    """Seconds a call: the least of all repeats, which noise cannot lower, and the median beside it."""

    least: float
    median: float


def interleaved(variants: Mapping[str, Callable[[], Any]], repeats: int = 30) -> dict[str, Timing]:
    """Time ``variants`` in turns, so that a busy moment of the machine meets all of them.

    Each is called twice before (it compiles there). Then in each of ``repeats`` rounds every variant is called at
    least once and for about 10 ms, every call timed alone: a short one gets its chance of an undisturbed moment as a
    long one does. A variant returns its arrays; the clock stops when they are ready.
    """

    def timed(call: Callable[[], Any]) -> float:
        start = time.perf_counter()
        jax.block_until_ready(call())
        return time.perf_counter() - start

    for call in variants.values():
        timed(call)
    calls = {name: max(1, min(100, int(0.01 / timed(call)))) for name, call in variants.items()}
    samples: dict[str, list[float]] = {name: [] for name in variants}
    for _ in range(repeats):
        for name, call in variants.items():
            samples[name] += [timed(call) for _ in range(calls[name])]
    return {name: Timing(min(times), median(times)) for name, times in samples.items()}


def compile_seconds(function: Callable[..., Any], *args: Any) -> tuple[float, float]:
    """Seconds to trace and lower, and to compile, the jitted ``function`` for ``args``, nothing cached."""
    jax.clear_caches()
    start = time.perf_counter()
    lowered = jax.jit(function).lower(*args)
    middle = time.perf_counter()
    lowered.compile()
    return middle - start, time.perf_counter() - middle


def machine() -> dict[str, Any]:
    """The machine, the versions and the commit that a result belongs to."""
    packages = ("sympol", "jax", "jaxlib", "numpy")
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": _commit(),
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "load": [round(load, 2) for load in os.getloadavg()],
        "python": platform.python_version(),
        "devices": [str(device.device_kind) for device in jax.devices()],
        "versions": {name: importlib.metadata.version(name) for name in packages},
    }


def write(name: str, results: Mapping[str, Any]) -> Path:
    """Write ``results`` with the machine beside them to studies/results/``name``.json."""
    path = ROOT / "studies" / "results" / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"machine": machine(), **results}, indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
    return path


def write_environments(
    name: str, settings: Mapping[str, Any], measured: Mapping[str, Mapping[str, Any]]
) -> Path:
    """Write what was measured of some environments; of the others stays what studies/results/``name``.json has.

    Each says when and at which commit it was measured, with which settings.
    """
    path = ROOT / "studies" / "results" / f"{name}.json"
    before = (
        json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"machine": {}, "environments": {}}
    )
    older = {
        env: {"measured": {key: before["machine"].get(key) for key in ("date", "commit")}, **result}
        for env, result in before["environments"].items()
    }
    now = {key: machine()[key] for key in ("date", "commit")}
    newer = {env: {"measured": {**now, **settings}, **result} for env, result in measured.items()}
    return write(name, {"environments": {**older, **newer}})


def _commit() -> str:
    """The commit, with a mark if src/ or studies/benchmarks/ hold something else."""

    def git(*arguments: str) -> str:
        return subprocess.run(("git", *arguments), cwd=ROOT, capture_output=True, text=True).stdout.strip()

    changed = git("status", "--porcelain", "--", "src", "studies/benchmarks")
    return git("rev-parse", "HEAD") + (" (changed)" if changed else "")


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    fields = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    name, family, model = (fields.get(key, "?") for key in ("model name", "cpu family", "model"))
    return f"{name} (family {family}, model {model})"
