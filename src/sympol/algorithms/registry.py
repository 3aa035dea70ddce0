"""The algorithms by name. Nothing here imports JAX, so that a config can be read without it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .algorithm import Algorithm

ALGORITHMS: dict[str, str | type[Algorithm]] = {
    "ppo": "sympol.algorithms.ppo:PPO",
    "a2c": "sympol.algorithms.a2c:A2C",
}
"""An `Algorithm`, or the module and name to import it from on first use. A new algorithm is one line here."""


def algorithm_class(name: str) -> type[Algorithm]:
    """Return the class of an algorithm.

    Args:
        name: Its name in `ALGORITHMS`, as in ``Config.algorithm``.

    Returns:
        The class, imported if it has not been used before.

    Raises:
        KeyError: There is no algorithm of this name; a `Config` never holds one.
    """
    entry = ALGORITHMS[name]
    if isinstance(entry, str):
        module, _, attribute = entry.partition(":")
        entry = ALGORITHMS[name] = getattr(import_module(module), attribute)
    return entry
