"""JSON and TOML that may come from a stranger, read with bounds on their size, their nesting and their memory.

Whatever is wrong with a text is a ValueError that says so in one line; no text makes the reader recurse without end,
and what is read nests so little that it can be copied, compared, printed and written again by recursion.
"""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any, Never

LARGEST = 2**26
"""Bytes of a file, and characters of a JSON text: about a million nodes, which take some 2 GB of memory to read."""
LARGEST_TOML = 2**20
"""Characters of a TOML text, which is written by hand."""
DEEPEST = 100
"""Lists and objects within each other."""
_STRING = re.compile(
    r'''"""(?:[^\\]|\\.)*?"""|\'{3}.*?\'{3}|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|\#[^\n]*''', re.DOTALL
)
"""Strings and comments of TOML."""
_DEEP_KEY = re.compile(rf"(?<![\w-])[\w-]+(?:[ \t]*\.[ \t]*[\w-]+){{{DEEPEST}}}")
"""A key such as ``a.a.a.a``: of n parts it makes n tables, and tomllib takes time in proportion to n squared."""


def read_file(path: Path) -> str:
    """Return the text of a file in UTF-8, with or without a byte-order mark; line breaks become ``\\n``.

    Raises:
        OSError: if the file cannot be read.
        ValueError: if it is larger than `LARGEST` or not in UTF-8.
    """
    with path.open("rb") as file:
        content = file.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise ValueError(f"the file is larger than {LARGEST // 2**20} MiB, which is the most that is read")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"it is not text in UTF-8 (byte {error.start:,} is wrong)") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_json(text: str) -> Any:
    """Return what a strict JSON text says; a byte-order mark before it is ignored.

    Raises:
        ValueError: if it is not strict JSON, larger than `LARGEST`, or nests deeper than `DEEPEST`.
    """
    if len(text) > LARGEST:
        raise ValueError(f"the JSON has {len(text):,} characters; at most {LARGEST:,} are read")
    try:
        content = json.loads(text.removeprefix("\ufeff"), parse_constant=_refuse)
    except json.JSONDecodeError as error:
        raise ValueError(f"not JSON (was the file cut off?): {error}") from error
    except ValueError as error:  # NaN, or a number of thousands of digits, whose message goes on about Python
        raise ValueError(str(error).split(";")[0]) from None
    except RecursionError:
        raise ValueError(_too_deep("the JSON")) from None
    if _nests_too_deeply(content):
        raise ValueError(_too_deep("the JSON"))
    return content


def read_toml(text: str, what: str, where: str = "") -> dict[str, Any]:
    """Return what a TOML text says.

    Args:
        text: The TOML.
        what: What to call it in messages, such as ``"the header"``.
        where: What to add where it is not TOML, such as ``", between +++ and +++,"``.

    Raises:
        ValueError: if it is not TOML, larger than `LARGEST_TOML`, or nests deeper than `DEEPEST`.
    """
    if len(text) > LARGEST_TOML:
        raise ValueError(f"{what} has {len(text):,} characters; at most {LARGEST_TOML:,} are read")
    if _DEEP_KEY.search(_STRING.sub("s", text)):
        raise ValueError(_too_deep(what))
    try:
        content = tomllib.loads(text.removeprefix("\ufeff"))
    except (
        ValueError
    ) as error:  # TOMLDecodeError is one, and so is what a number of thousands of digits raises
        raise ValueError(f"{what}{where} is not TOML: {str(error).split(';')[0]}") from error
    except RecursionError:
        raise ValueError(_too_deep(what)) from None
    if _nests_too_deeply(content):
        raise ValueError(_too_deep(what))
    return content


def _too_deep(what: str) -> str:
    return f"{what} nests too deeply: more than {DEEPEST} levels"


def _nests_too_deeply(content: object) -> bool:
    """Whether there are lists and objects within each other more than `DEEPEST` deep."""
    level = [content] if isinstance(content, dict | list) else []
    for _ in range(DEEPEST):
        inner = [part.values() if isinstance(part, dict) else part for part in level]
        level = [one for parts in inner for one in parts if isinstance(one, dict | list)]
        if not level:
            return False
    return True


def _refuse(constant: str) -> Never:
    raise ValueError(f"not strict JSON: it has no {constant}")
