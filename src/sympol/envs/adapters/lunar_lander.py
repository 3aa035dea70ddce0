"""The lunar landers, in Gymnasium and in machine code."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from ..entries import Adapter, Entry
from ..lunar_lander.engine import ENGINE, IDS
from .gymnasium import make


class LunarLander(Adapter):
    """The lunar landers by Gymnasium's ids."""

    def entry(self, env_id: str) -> Entry | None:
        """See `Adapter.entry`."""
        return Entry(host=partial(make, env_id), native=ENGINE) if env_id in IDS else None

    def ids(self) -> Iterable[str]:
        """See `Adapter.ids`."""
        return IDS
