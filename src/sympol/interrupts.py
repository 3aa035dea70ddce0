"""Ctrl-C in a command: noticed at any moment, answered within about a second, never lost.

Python calls a signal's handler in the main thread, between two bytecodes, and the handler can only raise in whatever
happens to run there. So a request can be lost in three ways: the main thread is inside machine code that does not
return (XLA executes a segment), it is inside a callback whose exceptions Python ignores (garbage collection,
``__del__``), or an ``except`` of other code catches it (an environment's, a user's). Every request is therefore
remembered before anything is raised, and a process that belongs to a command also has a thread that listens, and that
ends the process if the main thread does not.

The end is `os._exit`. Leaving as usual would take JAX apart while a thread of it may still compile, which is a
segmentation fault. Nothing is lost by it: what a run's folder holds is whole at any moment, whatever ends the process.
"""

from __future__ import annotations

import _thread
import contextlib
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, NoReturn

_REACTION = 0.25
"""Seconds after which the main thread is taken to be inside machine code."""
_GRACE = 1.0
"""Seconds that a command has to come to its end once it is to stop at once."""
_SHOW_CURSOR = "\x1b[?25h"

Decide = Callable[[int], bool]
"""Called with each signal, in the main thread or in the listening one: whether to stop at once."""


class Interrupts:
    """The signals sent to this process, and how it answers them."""

    def __init__(self) -> None:
        self.at_once = False
        """Whether the command is to stop at once; a `KeyboardInterrupt` is raised, too, but may be caught."""
        self._number: int = signal.SIGINT
        self._decide: Decide = lambda number: True
        self._words: Callable[[], str] = lambda: "interrupted"
        self._pipe: int | None = None
        self._last_word = _thread.allocate_lock()

    @property
    def status(self) -> int:
        """Return the exit status after the last signal: 130 after Ctrl-C, 143 after SIGTERM."""
        return 128 + self._number

    def listen(self) -> None:
        """Make this process a command's own: Ctrl-C ends it, whatever the main thread does.

        Outside of `heard` it ends immediately, as is right while modules are imported.
        """
        self._decide = self._leave_now
        if os.name == "posix":
            self._pipe, writing = os.pipe()
            os.set_blocking(self._pipe, False)
            os.set_blocking(writing, False)
            signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
            threading.Thread(target=self._watch, args=(self._pipe,), name="interrupts", daemon=True).start()
            sys.unraisablehook = self._ignored
        signal.signal(signal.SIGINT, self._handle)

    @contextlib.contextmanager
    def heard(
        self, decide: Decide, *, terms: bool = False, words: Callable[[], str] | None = None
    ) -> Iterator[None]:
        """Let ``decide`` answer Ctrl-C within the block; in a thread other than the main one, do nothing.

        Args:
            decide: See `Decide`. It may be called while anything else runs, so it must not raise and may not print
                through Python's streams.
            terms: Ask it about SIGTERM as well.
            words: The line to end with if the main thread cannot say it.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        kept = self._decide, self._words, self.at_once
        self._decide, self._words, self._number = decide, words or self._words, signal.SIGINT
        numbers = [signal.SIGINT, signal.SIGTERM] if terms else [signal.SIGINT]
        before = [(number, signal.signal(number, self._handle)) for number in numbers]
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, handler)
            self._decide, self._words, before_it = kept
            if self._pipe is None:  # the process lives on, and what is asked of it next is another matter
                self.at_once = before_it

    def take_last_word(self) -> bool:
        """Return True to the first caller, who prints how the command ended, and False to all later ones."""
        return self._pipe is None or self._last_word.acquire(blocking=False)

    def check(self) -> None:
        """Raise `KeyboardInterrupt` if the command is to stop at once, in case the first one was caught."""
        if self.at_once:
            raise KeyboardInterrupt

    def leave(self, status: int) -> NoReturn:
        """End the process, without taking apart what other threads may still use."""
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
        os._exit(status)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._answer(self._sent() if self._pipe is not None else bytes([number]))
        if self._pipe is None or not _imports(frame):  # `_end` will end it
            self.check()

    def _answer(self, numbers: bytes) -> None:
        for number in numbers:
            if self.at_once:
                return
            self._number = number
            if self._decide(number):
                self.at_once = True
                if (
                    self._pipe is not None
                ):  # not a threading.Thread: its locks may be held where the signal struck
                    _thread.start_new_thread(self._end, ())

    def _sent(self) -> bytes:
        """Return the signals since the last call: each is returned once, in either thread."""
        assert self._pipe is not None
        try:
            sent = os.read(self._pipe, 4096)
        except BlockingIOError:
            return b""
        return bytes(number for number in sent if number in (signal.SIGINT, signal.SIGTERM))

    def _watch(self, pipe: int) -> None:
        while True:
            select.select([pipe], [], [])
            time.sleep(_REACTION)
            self._answer(self._sent())  # nothing, if the main thread has looked

    def _end(self) -> None:
        time.sleep(_GRACE)
        if self.take_last_word():
            say(self._words())
        else:  # the main thread is saying it
            time.sleep(_GRACE)
        self.leave(self.status)

    def _leave_now(self, number: int) -> bool:
        say(self._words())
        self.leave(self.status)

    def _ignored(self, unraisable: Any) -> None:
        if self.at_once and isinstance(unraisable.exc_value, KeyboardInterrupt):
            _thread.start_new_thread(self._raise_again, ())
        else:
            sys.__unraisablehook__(unraisable)

    def _raise_again(self) -> None:
        time.sleep(0.01)
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, signal.SIGINT)

    def _forget(self) -> None:
        """Undo everything in a forked child, which would write its signals into the parent's pipe."""
        for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGTERM, signal.SIG_DFL)):
            if signal.getsignal(number) == self._handle:
                signal.signal(number, usual)
        if self._pipe is not None:
            signal.set_wakeup_fd(-1)
            sys.unraisablehook = sys.__unraisablehook__
            self._pipe = None


def _imports(frame: FrameType | None) -> bool:
    """Return whether a module is being imported; the machine code of some aborts where Python code raises."""
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


def say(line: str) -> None:
    """Write a line to the error stream from a signal's handler, where Python's own streams may be in use."""
    cursor = _SHOW_CURSOR if os.isatty(2) else ""
    with contextlib.suppress(OSError):
        os.write(2, f"{cursor}{line}\n".encode(errors="replace"))


interrupts = Interrupts()
"""The signals of this process."""
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=interrupts._forget)
