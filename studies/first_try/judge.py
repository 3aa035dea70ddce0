"""Collect the records of the study, one process for each; what is there already is not measured again.

A record belongs to an environment and its budget (by a hash of their source), a method and a seed. A tree also belongs
to the settings it was trained with and to the library (by a hash of its source), so that a change of the defaults is
measured anew while the baselines stand.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any

from ..benchmarks.timing import ROOT
from . import fresh, held_out
from .worker import tasks_of

Record = dict[str, Any]
FROZEN = {"held_out": held_out.digest, "fresh": fresh.digest}
"""The sets that must not change, with the functions that hash them."""


def library() -> str:
    """Return a short hash of the source of sympol."""
    whole = hashlib.sha256()
    for path in sorted((ROOT / "src" / "sympol").rglob("*")):
        if path.suffix in (".py", ".toml"):
            whole.update(path.read_bytes())
    return whole.hexdigest()[:12]


def key(record: Record) -> tuple[Any, ...]:
    """Return what tells a record from all others."""
    common = (record["set"], record["env"], record["digest"], record["method"], record["seed"])
    if record["method"] != "tree":
        return common
    return (*common, json.dumps(record["settings"], sort_keys=True), record["library"])


def read(paths: Iterable[Path]) -> list[Record]:
    """Return the records of files of JSON lines, one a key: the last one counts."""
    lines = [
        line for path in paths if path.exists() for line in path.read_text(encoding="utf-8").splitlines()
    ]
    return [*{key(record): record for record in map(json.loads, lines)}.values()]


def due(
    given_set: str,
    names: Sequence[str],
    methods: Sequence[str],
    seeds: Iterable[int],
    settings: dict[str, Any],
) -> Iterator[Record]:
    """Yield what to measure: all tasks with the first seed, then all with the second one."""
    tasks, code = tasks_of(given_set), library()
    frozen = {"frozen": FROZEN[given_set]()} if given_set in FROZEN else {}
    if "viper" in methods:  # the MLP comes with it
        methods = [method for method in methods if method != "mlp"]
    for seed in seeds:
        for name in names or tasks:
            for method in methods:
                wanted = {"set": given_set, "env": name, "digest": tasks[name].digest(), "method": method}
                made_with = {"settings": settings if method == "tree" else {}, "library": code, **frozen}
                yield {**wanted, "seed": seed, **made_with}


def measured(wanted: Record) -> list[Record]:
    """Measure in a process of its own.

    Raises:
        RuntimeError: The process failed; the message ends with what it wrote to its error stream.
    """
    command = [sys.executable, "-m", f"{__package__}.worker", json.dumps(wanted)]
    places = os.pathsep.join([str(ROOT / "src"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    env = {**os.environ, "PYTHONPATH": places, "OMP_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    if done.returncode:
        raise RuntimeError(f"{wanted['env']}, {wanted['method']}: {done.stderr[-1500:]}")
    return [{**wanted, **record} for record in json.loads(done.stdout.splitlines()[-1])]


def run(wanted: Iterable[Record], out: Path, processes: int = 1) -> int:
    """Measure what ``out`` does not hold yet, and append it there.

    Args:
        wanted: The records to have, see `due`.
        out: A file of JSON lines.
        processes: How many run at once.

    Returns:
        How many failed.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    there, lock = {key(record) for record in read([out])}, Lock()

    def one(record: Record) -> int:
        with lock:
            if key(record) in there:
                return 0
        try:
            found = measured(record)
        except RuntimeError as error:
            print(error, file=sys.stderr, flush=True)
            return 1
        with lock, out.open("a", encoding="utf-8") as file:
            for each in found:
                there.add(key(each))
                file.write(json.dumps(each) + "\n")
                print(
                    *(each[name] for name in ("env", "method", "seed", "return_mean", "seconds")), flush=True
                )
        return 0

    with ThreadPoolExecutor(processes) as pool:
        return sum(pool.map(one, wanted))
