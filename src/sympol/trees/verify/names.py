"""What names may be called: in full, or without the unit they end in."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

_UNIT = re.compile(r"(.*\S)\s*\([^()]*\)", re.DOTALL)


def without_units(names: Sequence[str]) -> Mapping[str, str]:
    """Return the short forms of names and the names: ``{"pole angle": "pole angle (rad)"}``.

    What would be short for two names, or is another one's full name, is short for none.
    """
    short = [(found[1], name) for name in names if (found := _UNIT.fullmatch(name))]
    called = Counter((*names, *(form for form, _ in short)))
    return {form: name for form, name in short if called[form] == 1}
