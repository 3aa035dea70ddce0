"""Reads a rule from left to right: names as they are or in quotes, words, numbers, signs."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from typing import Never

from ..floats import printable
from ..name_lookup import did_you_mean

WORDS = frozenset(
    (
        *("when", "then", "and", "or", "not", "never", "always", "is", "neither", "nor", "one", "of"),
        *("between", "in", "increasing", "decreasing"),
    )
)
"""The words of the language; a name that is one of them has to be quoted."""
RELATIONS = {
    "<=": "<=",
    ">=": ">=",
    "!=": "!=",
    "==": "=",
    "<": "<",
    ">": ">",
    "=": "=",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
}
_NUMBER = re.compile(r"[-+−]?(\d+(?:\.\d*)?|\.\d+)([eE][-+−]?\d{1,3})?(?![\w.])")
_QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_END_OF_NAME = re.compile(
    r"(<|>|=|≤|≥|≠|!=|\(|\)|,|$|\b(?:is|and|or|then|when|between|in|never|always|neither|nor)\b)"
)
_LONGEST_RULE = 10_000


class Scanner:
    """A place in the text of a rule. What it takes must stand there; what it finds may."""

    def __init__(self, text: str) -> None:
        """Begin at the beginning.

        Raises:
            ValueError: if the text is too long to have been written by hand.
        """
        if len(text) > _LONGEST_RULE:
            raise ValueError(f"a rule has at most {_LONGEST_RULE:,} characters, this one has {len(text):,}")
        self.text, self._at = text, 0

    def at_end(self) -> bool:
        """Whether nothing is left."""
        self._skip()
        return self._at == len(self.text)

    def word(self, *words: str) -> str | None:
        """Take the first of these words that stands here."""
        self._skip()
        for word in words:
            end = self._at + len(word)
            if self.text.startswith(word, self._at) and not _goes_on(self.text, end):
                self._at = end
                return word
        return None

    def sign(self, *signs: str) -> str | None:
        """Take the first of these signs that stands here."""
        self._skip()
        for sign in signs:
            if self.text.startswith(sign, self._at):
                self._at += len(sign)
                return sign
        return None

    def relation(self) -> str | None:
        """Take ``<``, ``<=``, ``>``, ``>=``, ``=`` or ``!=``, however they are written."""
        found = self.sign(*RELATIONS)
        return None if found is None else RELATIONS[found]

    def stands_relation(self) -> bool:
        """Whether a comparison stands here, which is not taken."""
        self._skip()
        return self.text.startswith((*RELATIONS, "between "), self._at)

    def number(self) -> Decimal | None:
        """Take a decimal number, exactly."""
        self._skip()
        found = _NUMBER.match(self.text, self._at)
        if found is None:
            return None
        self._at = found.end()
        try:
            return Decimal(found[0].replace("−", "-"))
        except InvalidOperation:
            self.fail(f"{found[0]} is no number")

    def name(self, names: Sequence[str]) -> str | None:
        """Take the longest of these names that stands here, or the one in quotes.

        Quotes are those of JSON. A name that is a word of the language has to be quoted.

        Raises:
            ValueError: if what is in quotes is none of them.
        """
        self._skip()
        quoted = _QUOTED.match(self.text, self._at)
        if quoted:
            try:
                name = json.loads(quoted[0], strict=False)
            except json.JSONDecodeError:
                self.fail(f"{quoted[0]} is not quoted as in JSON")
            if name not in names:
                self.fail(f"unknown name {printable(name)!r}; {did_you_mean(name, names)}")
            self._at = quoted.end()
            return name
        fitting = [name for name in names if self._stands_here(name)]
        if not fitting:
            return None
        longest = max(fitting, key=len)
        self._at += len(longest)
        return longest

    def fail_at_name(self, names: Sequence[str], what: str) -> Never:
        """Say that what stands here is none of these names.

        Raises:
            ValueError: always.
        """
        self._skip()
        end = _END_OF_NAME.search(self.text, self._at)
        name = self.text[self._at : end.start() if end else len(self.text)].strip()
        if not name:
            self.fail(f"expected {'an' if what[0] in 'aeiou' else 'a'} {what}; {did_you_mean(name, names)}")
        self.fail(f"unknown {what} {printable(name)!r}; {did_you_mean(name, names)}")

    def fail(self, problem: str) -> Never:
        """Say what is wrong, where.

        Raises:
            ValueError: always.
        """
        rest = self.text[self._at :].strip()
        where = f"at {printable(rest)[:60]!r}" if rest else "at the end"
        raise ValueError(f"{problem} ({where} of the rule {printable(self.text)[:200]!r})")

    def _skip(self) -> None:
        while self._at < len(self.text) and self.text[self._at].isspace():
            self._at += 1

    def _stands_here(self, name: str) -> bool:
        if not name or name in WORDS or not self.text.startswith(name, self._at):
            return False
        return not (name[-1].isalnum() and _goes_on(self.text, self._at + len(name)))


def _goes_on(text: str, at: int) -> bool:
    return at < len(text) and (text[at].isalnum() or text[at] == "_")
