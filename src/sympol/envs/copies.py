"""Copies of a Gymnasium environment to play whole episodes on: a bounded number, and closed whatever happens."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import gymnasium

from .spec import EnvSpec


@contextlib.contextmanager
def open_copies(spec: EnvSpec, wanted: int) -> Iterator[list[gymnasium.Env]]:
    """Open copies of an environment; close them afterwards.

    There may be fewer. An environment that needs a licence or a port for each copy raises an error when there is none
    left; the copies opened before are enough, as episodes are the same on any number of them. Where not even the first
    can be opened, the error is raised. An object that is the only copy stays open.

    Args:
        spec: The environment.
        wanted: The most copies to open; there are never more than `EnvSpec.most_copies`.

    Yields:
        The copies, at least one.
    """
    if spec.has_one_copy:
        yield [spec.make_host()]
        return
    with contextlib.ExitStack() as stack:
        copies: list[gymnasium.Env] = []
        for _ in range(min(wanted, spec.most_copies)):
            try:
                env = spec.make_host()
            except Exception:
                if not copies:
                    raise
                break
            if any(env is other for other in copies):
                break  # a function that returns the same object each time
            stack.callback(env.close)
            copies.append(env)
        yield copies
