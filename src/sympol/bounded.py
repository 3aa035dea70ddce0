"""JSON and TOML that may come from a stranger, parsed with bounds on their size, their nesting and their memory.

Every fault of a text is a ValueError of one line. No text makes the parser recurse without end, and what is returned
nests so little that it can be copied, compared, printed and written again by recursion.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from typing import Any, Never

LARGEST = 2**26
"""Characters of a text: as JSON about a million nodes, which take some 2 GB of memory to read."""
LARGEST_BY_HAND = 2**20
"""Characters of a TOML text that is written by hand."""
DEEPEST = 100
"""Lists and objects within each other."""
_MOST_DOTS = 10_000_000
"""Sum of the squared numbers of dots in the lines of a TOML text."""


def parse_json(text: str, what: str = "the JSON", *, strict: bool = True) -> Any:
    """Return the content of a JSON text; a byte-order mark before it is ignored.

    Args:
        text: The JSON.
        what: What to call it in messages.
        strict: Whether NaN and Infinity, which are no JSON, are refused.

    Raises:
        ValueError: It is not JSON, larger than `LARGEST`, or nests deeper than `DEEPEST`.
    """
    _require_size(text, what, LARGEST)
    refuse = _refuse if strict else None
    return _bounded(lambda: json.loads(text.removeprefix("\ufeff"), parse_constant=refuse), what)


def parse_toml(text: str, what: str, where: str = "", most: int = LARGEST) -> dict[str, Any]:
    """Return the content of a TOML text; a byte-order mark before it is ignored.

    Args:
        text: The TOML.
        what: What to call it in messages, such as ``"the header"``.
        where: What to add where it is not TOML, such as ``", between +++ and +++,"``.
        most: Its largest number of characters.

    Raises:
        ValueError: It is not TOML, too large, or nests deeper than `DEEPEST`.
    """
    _require_size(text, what, most)
    # a key such as a.a.a makes a table for each part, and tomllib keeps every beginning: memory that grows with the
    # square of its length
    if sum(line.count(".") ** 2 for line in text.split("\n")) > _MOST_DOTS:
        raise ValueError(_too_deep(what))
    return _bounded(lambda: tomllib.loads(text.removeprefix("\ufeff")), what, f"{what}{where} is not TOML: ")


def _require_size(text: str, what: str, most: int) -> None:
    if len(text) > most:
        raise ValueError(f"{what} has {len(text):,} characters; at most {most:,} are read")


def _bounded(parse: Callable[[], Any], what: str, not_valid: str = "") -> Any:
    try:
        content = parse()
    except RecursionError:
        raise ValueError(_too_deep(what)) from None
    except json.JSONDecodeError as error:
        raise ValueError(f"not JSON (was the file cut off?): {error}") from error
    except (
        ValueError
    ) as error:  # TOMLDecodeError is one; of a number of thousands of digits it adds advice about Python
        raise ValueError(f"{not_valid}{str(error).split(';')[0]}") from error
    level = [content]
    for _ in range(DEEPEST + 1):
        inner = [
            one.values() if isinstance(one, dict) else one for one in level if isinstance(one, dict | list)
        ]
        if not inner:
            return content
        level = [one for parts in inner for one in parts]
    raise ValueError(_too_deep(what))


def _too_deep(what: str) -> str:
    return f"{what} nests too deeply: more than {DEEPEST} levels"


def _refuse(constant: str) -> Never:
    raise ValueError(f"not strict JSON, which has no {constant}: {constant} is no number")
