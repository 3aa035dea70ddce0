"""Malformed inputs for `studies.benchmarks.fuzz`: valid ones that are changed a little, at random from a seed.

A `Random` is the only source of chance, so that the same seed and number give the same input on every machine.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Callable, Sequence
from random import Random
from typing import Any, TypeVar

import tomli_w

T = TypeVar("T")

WORDS = (
    *("", " ", "\t", "\n", "\r", "\x00", "\x07", "\x1b[31m", "\x1b]0;title\x07", "\x9b1m", "\x7f", "\x85"),
    *(
        "\u2028",
        "\u202e",
        "\ufeff",
        "\ud800",
        "\udcff",
        "\u0301",
        "é",
        "≤",
        "├─ yes: ",
        "└─ no:  ",
        "日本",
        "💥",
    ),
    *(
        "0",
        "-0",
        "1",
        "-1",
        "2",
        "0.5",
        ".5",
        "1e-45",
        "1e38",
        "1e39",
        "1e999",
        "-1e999",
        "1_000",
        "0x1f",
        "1e",
    ),
    *("9" * 400, "9" * 5000, "18446744073709551616", "nan", "NaN", "inf", "-inf", "Infinity", "-Infinity"),
    *(
        "null",
        "true",
        "false",
        "[]",
        "{}",
        '""',
        "[1, 2]",
        '{"a": 1}',
        "'",
        '"',
        '"""',
        "\\",
        "\\ud800",
        "\\n",
    ),
    *(
        "[bold]",
        "[/]",
        "[red]x[/red]",
        "{0}",
        "%s",
        "$(id)",
        "`id`",
        "; rm",
        "<script>",
        "--",
        "-",
        "=",
        "#",
        "+++",
    ),
    *(
        "(",
        ")",
        "[",
        "]",
        "{",
        "}",
        ",",
        ":",
        ";",
        "..",
        ".",
        "*",
        "~",
        "|",
        "&",
        "name",
        "value",
        "x",
        "run",
    ),
)
"""What has been misread before: escape sequences, marks, numbers beyond every type, the syntax of formats."""

VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        0,
        -0.0,
        1,
        -1,
        2,
        0.5,
        1e-45,
        1e38,
        1e39,
        1e300,
        float("nan"),
        float("inf"),
        10**400,
    ),
    *(2**31 - 1, 2**31, 2**53, 2**53 + 1, 2**63, 2**64, -(2**31) - 1, -(2**63), -(10**400)),
    *("", "x", "\x1b[31m", "\ud800", "\x00", "inf", "-inf", "nan", "a" * 5000, [], {}, [[]], [{}], {"": {}}),
    *([0], [1, "x"], {"value": [0, 0]}, [None] * 40, list(range(300))),
)
"""What stands in a document in place of something else."""

EVIL = "fuzz_evil"
"""A module that no command may import because a file names it."""
NAMES = (
    *(
        "\x1b]0;title\x07",
        "\x1b[31m",
        "\x9b31m",
        "x\nerror: y",
        "\r",
        "\u202e",
        "[bold]x",
        "{0} %s",
        "",
        "\x00",
    ),
    *(
        f"{EVIL}:CartPole-v1",
        f"{EVIL}:X-v0",
        "../../outside/precious.txt",
        "json:X-v0",
        "a" * 5000,
        '\'); x = ("""',
    ),
)
"""What a stranger may call something."""

_PLACE = re.compile(r"-?\d+(?:\.\d+)?|\w+|[^\w\s]")


def changed_text(dice: Random, text: str, words: Sequence[str] = ()) -> str:
    """Return a text with some changes: parts that are gone, doubled, swapped, or another word."""
    for _ in range(_few(dice)):
        text = dice.choice(_TEXT_CHANGES)(dice, text, words)
    return text


def _few(dice: Random) -> int:
    """How many changes: mostly one, for an input that is almost right gets far."""
    return dice.choice((1, 1, 1, 1, 2, 2, 4))


def _word(dice: Random, words: Sequence[str]) -> str:
    return dice.choice(words) if words and dice.random() < 0.5 else dice.choice(WORDS)


def _slice(dice: Random, length: int) -> slice:
    start = dice.randint(0, length)
    return slice(start, min(length, start + dice.choice((0, 1, 1, 2, 5, 20, 200))))


def _cut(dice: Random, text: str, words: Sequence[str]) -> str:
    part = _slice(dice, len(text))
    return text[: part.start] + text[part.stop :]


def _cut_off(dice: Random, text: str, words: Sequence[str]) -> str:
    return text[: dice.randint(0, len(text))]


def _insert(dice: Random, text: str, words: Sequence[str]) -> str:
    part = _slice(dice, len(text))
    return text[: part.start] + _word(dice, words) + text[dice.choice((part.start, part.stop)) :]


def _repeat(dice: Random, text: str, words: Sequence[str]) -> str:
    part = _slice(dice, len(text))
    times = dice.choice((2, 2, 3, 10, 2000))
    return text[: part.start] + text[part][:20] * times + text[part.stop :]


def _replace_word(dice: Random, text: str, words: Sequence[str]) -> str:
    places = [*_PLACE.finditer(text[:20_000])]
    if not places:
        return _word(dice, words)
    place = dice.choice(places)
    return text[: place.start()] + _word(dice, words) + text[place.end() :]


def _swap_words(dice: Random, text: str, words: Sequence[str]) -> str:
    places = [*_PLACE.finditer(text[:20_000])]
    if len(places) < 2:
        return text
    one, other = sorted(dice.sample(places, 2), key=lambda place: place.start())
    between = text[one.end() : other.start()]
    return text[: one.start()] + other.group() + between + one.group() + text[other.end() :]


def _lines(dice: Random, text: str, words: Sequence[str]) -> str:
    return "\n".join(changed_list(dice, text.split("\n")))


def _character(dice: Random, text: str, words: Sequence[str]) -> str:
    at = dice.randint(0, len(text))
    return text[:at] + chr(dice.choice((dice.randrange(32, 127), dice.randrange(256)))) + text[at + 1 :]


def _nested(dice: Random, text: str, words: Sequence[str]) -> str:
    """Brackets in brackets, more than a stack is deep."""
    left, right = dice.choice(
        (("[", "]"), ("(", ")"), ('{"a":', "}"), ("not ", ""), ("{a=", "}"), ("[a.", "]"))
    )
    depth, at = dice.choice((3, 50, 2000, 20_000)), dice.randint(0, len(text))
    closed = right * depth if dice.random() < 0.5 else ""
    return text[:at] + left * depth + closed + text[at:]


_TEXT_CHANGES: tuple[Callable[[Random, str, Sequence[str]], str], ...] = (
    *(_cut, _insert, _insert, _replace_word, _replace_word, _replace_word, _swap_words, _lines, _character),
    *(_repeat, _cut_off, _nested),
)


def changed_list(dice: Random, items: list[T]) -> list[T]:
    """Return a list in which one item is gone, doubled, or elsewhere."""
    items = [*items]
    if items:
        item = items.pop(dice.randrange(len(items)))
        for _ in range(dice.choice((0, 1, 2))):
            items.insert(dice.randint(0, len(items)), item)
    return items


def changed_document(dice: Random, document: Any) -> Any:
    """Return JSON's or TOML's content with some values replaced, moved, gone, or under another name."""
    document = _copy(document)
    for _ in range(_few(dice)):
        places = [*_places(document)]
        if not places:
            return _copy(dice.choice(VALUES))
        names = [(holder, key) for holder, key in places if isinstance(holder[key], str)]
        if names and dice.random() < 0.2:
            holder, key = dice.choice(names)
            holder[key] = dice.choice(NAMES)
            continue
        holder, key = dice.choice(places)
        change = dice.random()
        if change < 0.35:
            alike = [value for value in VALUES if type(value) in _alike(holder[key])]
            holder[key] = _copy(dice.choice(alike or VALUES))
        elif change < 0.5:
            holder[key] = _copy(dice.choice(VALUES))
        elif change < 0.65:
            other, its = dice.choice(places)
            holder[key] = _copy(other[its]) if its in _keys(other) else None
        elif change < 0.8:
            del holder[key]
        elif isinstance(holder, list):
            holder[:] = changed_list(dice, holder)
        elif isinstance(value := holder[key], str):
            holder[key] = changed_text(dice, value)
        else:
            holder[changed_text(dice, key)] = holder.pop(key)
    return document


def _copy(document: Any) -> Any:
    return json.loads(json.dumps(document))


def _alike(value: Any) -> tuple[type, ...]:
    return (int, float) if type(value) in (int, float) else (type(value),)


def _places(document: Any) -> list[tuple[Any, Any]]:
    found, awaited = [], [document]
    while awaited:
        holder = awaited.pop()
        for key in _keys(holder):
            found.append((holder, key))
            awaited.append(holder[key])
    return found


def _keys(holder: Any) -> list[Any]:
    if isinstance(holder, dict):
        return [*holder]
    return [*range(len(holder))] if isinstance(holder, list) else []


def as_bytes(text: str) -> bytes:
    """A text as a file holds it; what UTF-8 has not becomes bytes that are none of it."""
    return text.encode("utf-8", "surrogatepass")


def as_toml(document: Any) -> str | None:
    """Write a document; None where it holds what TOML has not."""
    with contextlib.suppress(AttributeError, TypeError, ValueError):
        return tomli_w.dumps(document)
    return None


def as_argument(word: str) -> str | None:
    """A word as the shell can give it to a program; None where it cannot."""
    with contextlib.suppress(UnicodeEncodeError):
        return None if "\x00" in word else os.fsdecode(os.fsencode(word))
    return None


def smaller(given: Any, still: Callable[[Any], bool], tries: int = 150) -> Any:
    """Return as little of a text or a list as is still wrong: halves, quarters, … are left out while that is so."""
    if not isinstance(given, str | bytes | list | tuple):
        return given
    size = max(1, len(given) // 2)
    while tries > 0:
        at = 0
        while at < len(given) and tries > 0:
            shorter = given[:at] + given[at + size :]  # pyright: ignore[reportOperatorIssue]
            tries -= 1
            if still(shorter):
                given = shorter
            else:
                at += size
        if size == 1:
            break
        size = max(1, size // 2)
    return given
