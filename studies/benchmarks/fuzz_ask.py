"""Ask an input, within limits, and say what came of it; for `studies.benchmarks.fuzz`."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import resource
import signal
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any, Protocol, TypeAlias

from .fuzz_inputs import smaller
from .timing import ROOT

SECONDS = 5.0
"""Processor time of one input; other programs on the machine do not count."""
WAIT = 60.0
"""Seconds on the clock, for what waits and computes nothing."""
SILENCE = 180.0
"""Seconds without a word from the process that asks, after which it is ended: it hangs where no signal reaches."""
MEMORY = 2 * 1024**3
"""Bytes that one input may take beyond what the process had."""


class Broken(Exception):
    """The rule is broken without an exception: of which kind, and how."""

    def __init__(self, kind: str, detail: str = "") -> None:
        super().__init__(f"{kind}: {detail}" if detail else kind)
        self.kind = kind


class TooLong(BaseException):
    """An input takes too long. Not an `Exception`, which what is asked may catch."""


class Fuzzer(Protocol):
    """One class of inputs."""

    def make(self, dice: Random) -> tuple[Any, ...]:
        """An input; its last part is what may be made shorter while it still fails."""
        ...

    def ask(self, given: tuple[Any, ...]) -> bool:
        """Whether it was answered, not refused. Any exception breaks the rule."""
        ...


InputClass: TypeAlias = Callable[[Path], Fuzzer]
"""Sets a class of inputs up in a scratch folder."""


@dataclass(frozen=True)
class Failure:
    """An input that breaks the rule."""

    kind: str
    """What happened, and where: the same for the same cause."""
    number: int
    given: str
    detail: str


@dataclass
class Found:
    """What came of many inputs."""

    inputs: int = 0
    answered: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    failures: dict[str, Failure] = field(default_factory=dict)
    """The first of each kind."""

    def add(self, outcome: bool | Failure) -> None:
        """Count one."""
        self.inputs += 1
        if isinstance(outcome, Failure):
            self.kinds[outcome.kind] += 1
            self.failures.setdefault(outcome.kind, outcome)
        else:
            self.answered += outcome

    def fields(self) -> dict[str, Any]:
        """As it is kept."""
        failed = self.kinds.total()
        refused = self.inputs - self.answered - failed
        kinds = dict(self.kinds.most_common())
        return {
            "inputs": self.inputs,
            "answered": self.answered,
            "refused": refused,
            "failed": failed,
            "kinds": kinds,
        }


def outcomes(fuzzer: Fuzzer, seed: int, numbers: Iterable[int]) -> Iterator[tuple[int, bool | Failure]]:
    """Ask inputs one after another; the first failure of each kind has its shortest input."""
    known: set[str] = set()
    for number in numbers:
        given = fuzzer.make(Random(f"{seed} {number}"))
        answered = asked(fuzzer, given)
        if isinstance(answered, tuple):
            kind, detail = answered
            if kind not in known:
                known.add(kind)
                given = _shortest(fuzzer, given, kind)
            answered = Failure(kind, number, repr(given), detail)
        yield number, answered


def asked(
    fuzzer: Fuzzer, given: tuple[Any, ...], seconds: float = SECONDS, memory: int = MEMORY
) -> bool | tuple[str, str]:
    """Whether an input was answered; or the kind of failure, and all that is known of it."""
    try:
        with limits(seconds, memory):
            return fuzzer.ask(given)
    except Broken as error:
        return error.kind, str(error)
    except TooLong as error:
        return f"too long in {_place(error, innermost=False)}", _words(error)
    except MemoryError as error:
        return f"too much memory in {_place(error, innermost=False)}", _words(error)
    except Exception as error:
        return f"{type(error).__name__} in {_place(error, innermost=True)}", _words(error)


def _words(error: BaseException) -> str:
    words = "".join(traceback.format_exception(error))
    return words if len(words) < 6000 else f"{words[:3000]}\n…\n{words[-3000:]}"


def _place(error: BaseException, *, innermost: bool) -> str:
    """Where in sympol it happened: the last function, or the first behind the commands."""
    source = ROOT / "src" / "sympol"
    here = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    files = [(Path(frame.f_code.co_filename), frame.f_code.co_name) for frame in here]
    ours = [(path.relative_to(source), name) for path, name in files if path.is_relative_to(source)]
    behind = [one for one in ours if one[0].parts[0] not in ("cli",)] or ours
    if not ours:
        return ": ".join(map(str, files[-1])) if files else "?"
    return ": ".join(map(str, ours[-1] if innermost else behind[0]))


def _shortest(fuzzer: Fuzzer, given: tuple[Any, ...], kind: str) -> tuple[Any, ...]:
    if kind.startswith("too "):  # each try would take as long
        return given

    def still(part: Any) -> bool:
        answered = asked(fuzzer, (*given[:-1], part))
        return isinstance(answered, tuple) and answered[0] == kind

    return (*given[:-1], smaller(given[-1], still))


@contextlib.contextmanager
def limits(seconds: float, memory: int) -> Iterator[None]:
    """Raise TooLong or MemoryError in what takes more."""

    def stop(number: int, frame: object) -> None:
        raise TooLong

    timers = {signal.ITIMER_PROF: (signal.SIGPROF, seconds), signal.ITIMER_REAL: (signal.SIGALRM, WAIT)}
    before = {number: signal.signal(number, stop) for number, _ in timers.values()}
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_taken() + memory, hard))
    try:
        for timer, (_, length) in timers.items():
            signal.setitimer(timer, length, 1)  # again each second: a handler or a finaliser may swallow one
        yield
    finally:
        for timer in timers:
            signal.setitimer(timer, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _taken() -> int:
    """Bytes of address space that this process has."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def in_process(kind: InputClass, seed: int, numbers: Iterable[int], scratch: Path) -> Found:
    """Ask inputs of a class in this process."""
    found = Found()
    for _, outcome in outcomes(kind(scratch), seed, numbers):
        found.add(outcome)
    return found


def apart(kind: InputClass, seed: int, inputs: int) -> Found:
    """Ask inputs of a class in a process of its own, and in another one after each that ends it."""
    found, first = Found(), 0
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        while first < inputs:
            here, there = spawn.Pipe(duplex=False)
            process = spawn.Process(target=_work, args=(there, kind, seed, first, inputs, scratch))
            process.start()
            there.close()
            first, begun = _heard(here, found, first)
            process.join(10)
            process.kill()
            process.join()
            if not begun:
                raise RuntimeError(f"{kind} cannot be set up")
            if first < inputs:
                found.add(Failure(f"the process ended with {process.exitcode}", first, "see --only", ""))
                first += 1
    return found


def _heard(pipe: multiprocessing.connection.Connection, found: Found, first: int) -> tuple[int, bool]:
    """Count what the process says; return the first number of which it said nothing, and whether it was set up."""
    begun = False
    with contextlib.suppress(EOFError):
        while pipe.poll(SILENCE):
            if (said := pipe.recv()) is None:
                begun = True
                continue
            number, outcome = said
            if isinstance(outcome, Failure) and outcome.kind not in found.failures:
                print(f"{outcome.kind}\n  input {number}: {outcome.given[:300]}", flush=True)
            found.add(outcome)
            first = number + 1
    return first, begun


def _work(
    pipe: multiprocessing.connection.Connection,
    kind: InputClass,
    seed: int,
    first: int,
    end: int,
    scratch: str,
) -> None:
    fuzzer = kind(Path(scratch))
    pipe.send(None)  # it is set up
    for said in outcomes(fuzzer, seed, range(first, end)):
        pipe.send(said)
