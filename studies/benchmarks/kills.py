"""Trainings killed at random moments end as if they had not been: to the byte.

    python -m studies.benchmarks.kills [--kills 100] [--seed 0] [KIND ...]

Small trainings of five kinds, each a process of its own that is ended by SIGKILL: while it starts, in its first
write, at a save, while it evaluates and draws its tree at the end. Then the same command line goes on by `sympol
resume` (or begins anew, where no run was there yet), is perhaps killed again, and in the end policy.json, the last
checkpoint, metrics.csv (but for the two columns of the clock) and the tree's other files are those of a training
that nobody killed. Writes studies/results/kills.json.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from .timing import arguments_of, write

EVALS = 16
SMALL = (
    *(
        "--total-timesteps",
        "8192",
        "--depth",
        "3",
        "--num-envs",
        "4",
        "--num-steps",
        "16",
        "--minibatch-size",
        "64",
    ),
    *("--num-epochs", "1", "--critic-hidden", "8", "--num-evals", str(EVALS), "--num-eval-episodes", "4"),
    *("--eval-episodes", "4"),
)
KINDS: dict[str, tuple[str, ...]] = {
    "JAX": ("CartPole-v1",),
    "host": ("FrozenLake-v1",),
    "native": ("LunarLander-v3",),
    "start": ("CartPole-v1", "--start", "tree.txt"),
    "max-nodes": ("CartPole-v1", "--max-nodes", "7"),
}
MOMENTS = {"anywhere": 3, "first write": 2, "save": 8, "end": 2}
"""When to kill, and how often relative to each other."""
FILES = ("policy.json", "policy.py", "tree.txt", "tree.svg", "start.json")
LONGEST = 600.0
"""Seconds that one process may take."""


class Kind:
    """Trainings of one kind, in a folder of their own."""

    def __init__(self, name: str, folder: Path, cache: Path, dice: random.Random) -> None:
        self.words = (*KINDS[name], *SMALL)
        self.folder, self.dice = folder, dice
        self.counts: Counter[str] = Counter()
        self.moments: Counter[str] = Counter()
        self.failures: list[str] = []
        self.environment = {
            **os.environ,
            "JAX_PLATFORMS": "cpu",
            "JAX_COMPILATION_CACHE_DIR": str(cache),
            "NUMBA_CACHE_DIR": str(cache / "numba"),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
            "JAX_DISABLE_MOST_OPTIMIZATIONS": "true",
        }
        folder.mkdir()
        header = '+++\nenv = "CartPole-v1"\n+++\n'
        listing = "pole angle (rad) <= 0.02\n  yes: push left\n  no: push right\n"
        (folder / "tree.txt").write_text(header + listing)
        for name in (
            "warm",
            "whole",
        ):  # the second finds all programs in the cache, as those that are killed do
            began = time.perf_counter()
            if problem := self._end(self._begin(folder / name)):
                raise RuntimeError(f"{' '.join(self.words)}: {problem}")
            self.seconds = time.perf_counter() - began
        self.whole = outcome(folder / "whole")

    def kill(self, most: int) -> None:
        """One training: killed ``most`` times at most, gone on with, and compared."""
        run = self.folder / f"run-{self.counts['trainings']}"
        self.counts["trainings"] += 1
        kills = 0
        while True:
            process = self._begin(run)
            if kills < most and self._killed(process, run):
                kills += 1
                if self.dice.random() < 0.7:
                    most = kills  # and now to the end
                continue
            if problem := self._end(process):
                self.failures.append(f"{run.name} after {kills} kills: {problem}")
            elif different := differences(outcome(run), self.whole):
                self.failures.append(f"{run.name} after {kills} kills differs in {', '.join(different)}")
            else:
                self.counts["same"] += 1
            return

    def _begin(self, run: Path) -> subprocess.Popen[str]:
        """Train, or go on where there is a run."""
        resumes = (run / "config.toml").exists()
        self.counts["resumes"] += resumes
        words = ["resume", run.name] if resumes else ["train", *self.words, "--run-dir", run.name]
        return subprocess.Popen(
            [sys.executable, "-m", "sympol", *words],
            cwd=run.parent,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    @staticmethod
    def _end(process: subprocess.Popen[str]) -> str:
        """Wait for the end; return what went wrong."""
        try:
            _, said = process.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return f"not at its end after {LONGEST:.0f} s"
        return "" if process.returncode == 0 else f"status {process.returncode}: {said[-2000:]}"

    def _killed(self, process: subprocess.Popen[str], run: Path) -> bool:
        """Kill at a random moment; whether there was anything left to kill."""
        moment = self.dice.choices([*MOMENTS], weights=[*MOMENTS.values()])[0]
        step, last = newest(run), int(self.words[self.words.index("--total-timesteps") + 1])
        if moment == "anywhere":
            time.sleep(self.dice.uniform(0, self.seconds))
        elif moment == "first write":
            _wait(process, lambda: run.is_dir() and any(run.iterdir()))
            time.sleep(self.dice.uniform(0, 0.004))
        elif moment == "save":
            saves = self.dice.randint(1, EVALS)
            _wait(process, lambda: newest(run) >= min(last, step + saves * last // EVALS))
            time.sleep(self.dice.uniform(0, 0.05))
        else:
            _wait(process, lambda: newest(run) >= last)
            time.sleep(self.dice.uniform(0, 1.5))
        process.kill()
        process.communicate()
        killed = process.returncode == -9
        self.counts["kills"] += killed
        self.moments[moment] += killed
        return killed

    def fields(self) -> dict[str, Any]:
        """As they are kept."""
        return {
            "command": f"sympol train {' '.join(self.words)}",
            **{name: self.counts[name] for name in ("kills", "resumes", "trainings", "same")},
            "moments": dict(self.moments),
            "failures": self.failures,
        }


def _wait(process: subprocess.Popen[str], until: Any) -> None:
    deadline = time.monotonic() + LONGEST
    while process.poll() is None and not until() and time.monotonic() < deadline:
        time.sleep(0.0005)


def newest(run: Path) -> int:
    """The step of the last checkpoint."""
    return max((int(file.stem) for file in (run / "checkpoints").glob("*.json")), default=0)


def outcome(run: Path) -> dict[str, object]:
    """What two trainings must have in common."""
    found: dict[str, object] = {name: (run / name).read_bytes() for name in FILES if (run / name).exists()}
    last = run / "checkpoints" / f"{newest(run):012d}.safetensors"
    found["checkpoint"] = last.name, last.read_bytes(), last.with_suffix(".json").read_bytes()
    rows = (run / "metrics.csv").read_text(encoding="utf-8").splitlines()
    clock = [i for i, name in enumerate(rows[0].split(",")) if name in ("time/time_elapsed", "time/fps")]
    found["metrics.csv"] = [[x for i, x in enumerate(row.split(",")) if i not in clock] for row in rows]
    return found


def differences(one: dict[str, object], other: dict[str, object]) -> list[str]:
    """The names of what is not the same."""
    return [name for name in sorted(one.keys() | other.keys()) if one.get(name) != other.get(name)]


def main() -> None:
    parser = arguments_of(__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--kills", type=int, default=100, help="of all kinds together")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    names = given.kinds or [*KINDS]
    if unknown := set(names) - set(KINDS):
        parser.error(f"unknown kind {unknown.pop()!r}; there are {', '.join(KINDS)}")
    most = -(-given.kills // len(names))
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="kills-") as scratch:
        for name in names:
            began = time.perf_counter()
            kind = Kind(
                name, Path(scratch) / name, Path(scratch) / "cache", random.Random(f"{given.seed} {name}")
            )
            while kind.counts["kills"] < most:
                kind.kill(min(3, most - kind.counts["kills"]))
            found[name] = {**kind.fields(), "seconds": round(time.perf_counter() - began, 1)}
            print(name, found[name], flush=True)
    total = Counter[str]()
    for one in found.values():
        total.update({key: one[key] for key in ("kills", "resumes", "trainings", "same")})
    total["failures"] = sum(len(one["failures"]) for one in found.values())
    print(f"{dict(total)}; written to {write('kills', {'seed': given.seed, **total, 'kinds': found})}")


if __name__ == "__main__":
    main()
