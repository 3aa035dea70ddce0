"""Malformed inputs by the thousand: each must be answered or refused in one line.

    python -m studies.benchmarks.fuzz [CLASS ...] [--inputs 10000] [--seed 0]
    python -m studies.benchmarks.fuzz CLASS --only NUMBER

Classes: trees as JSON, trees as text, properties to verify, run folders, the flags of every command, observations.
The rule for each input: an answer, or one line that says what is wrong. Never another exception, never more than a
few seconds or a bounded amount of memory, never a file lost or written elsewhere, never an escape sequence on the
terminal. Valid inputs are changed at random; the seed and the number of an input give it again, and ``--only`` asks
that one alone. Writes studies/results/fuzz.json, and each kind of failure, with its shortest input, to runs/fuzz.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from random import Random

from .fuzz_ask import Found, apart, asked
from .fuzz_classes import CLASSES
from .timing import ROOT, arguments_of, write


def keep(name: str, seed: int, found: Found) -> None:
    """Write each kind of failure to a file."""
    folder = ROOT / "runs" / "fuzz" / name
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.txt"):
        old.unlink()
    for failure in found.failures.values():
        again = f"python -m studies.benchmarks.fuzz {name} --seed {seed} --only {failure.number}"
        words = f"{failure.kind}\n{again}\n\n{failure.given}\n\n{failure.detail}\n"
        (folder / f"{failure.number}.txt").write_text(words, encoding="utf-8", errors="backslashreplace")


def main() -> None:
    parser = arguments_of(__doc__)
    parser.add_argument("classes", nargs="*", metavar="CLASS", help=", ".join(CLASSES))
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, help="ask this input alone, and write nothing")
    given = parser.parse_args()
    if unknown := set(given.classes) - set(CLASSES):
        parser.error(f"unknown class {unknown.pop()!r}; there are {', '.join(CLASSES)}")
    if given.only is not None:
        _only(given.classes, given.seed, given.only)
        return
    path = ROOT / "studies" / "results" / "fuzz.json"
    kept = json.loads(path.read_text(encoding="utf-8"))["classes"] if path.exists() else {}
    for name in given.classes or CLASSES:
        began = time.perf_counter()
        found = apart(CLASSES[name], given.seed, given.inputs)
        seconds = round(time.perf_counter() - began, 1)
        kept[name] = {"seed": given.seed, **found.fields(), "seconds": seconds}
        keep(name, given.seed, found)
        print(name, json.dumps(kept[name], indent=1), flush=True)
        write("fuzz", {"classes": kept})


def _only(classes: list[str], seed: int, number: int) -> None:
    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        for name in classes or CLASSES:
            fuzzer = CLASSES[name](Path(scratch))
            given = fuzzer.make(Random(f"{seed} {number}"))
            print(name, repr(given)[:5000], flush=True)
            answered = asked(fuzzer, given)
            print("\n".join(answered) if isinstance(answered, tuple) else answered)


if __name__ == "__main__":
    main()
