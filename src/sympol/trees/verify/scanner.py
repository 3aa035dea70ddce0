"""A scanner for the text of a rule: words of the language, names of a tree, decimal numbers and signs.

Names are those of the tree at hand and may hold blanks, signs and words of the language, so a rule cannot be cut
into tokens beforehand: what may stand at a place decides how it is read there.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from typing import Never

from ..floats import printable
from ..name_lookup import did_you_mean

KEYWORDS = frozenset(
    (
        *("when", "then", "and", "or", "not", "never", "always", "is", "neither", "nor", "one", "of"),
        *("between", "in", "increasing", "decreasing"),
    )
)
"""The words of the language. A name that equals one of them must be quoted."""
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
"""Every spelling of a relation and its canonical one; a spelling comes before those that it starts with."""
_NUMBER = re.compile(r"[-+−]?(\d+(?:\.\d*)?|\.\d+)([eE][-+−]?\d{1,3})?(?![\w.])")
_QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_END_OF_NAME = re.compile(
    r"(<|>|=|≤|≥|≠|!=|\(|\)|,|$|\b(?:is|and|or|then|when|between|in|never|always|neither|nor)\b)"
)
_MAX_LENGTH = 10_000


class Scanner:
    """A position in the text of a rule that moves forward as parts of it are taken.

    The ``take_`` methods return None and stay where they are if the part is not there.

    Args:
        text: The rule.

    Raises:
        ValueError: If the text has more than 10,000 characters.
    """

    def __init__(self, text: str) -> None:
        """Start at the beginning of the text."""
        if len(text) > _MAX_LENGTH:
            raise ValueError(f"a rule has at most {_MAX_LENGTH:,} characters, this one has {len(text):,}")
        self.text, self._at = text, 0

    def at_end(self) -> bool:
        """Return whether only blanks are left."""
        self._skip_blanks()
        return self._at == len(self.text)

    def at_relation(self) -> bool:
        """Return whether a comparison starts here, without taking it."""
        self._skip_blanks()
        return self.text.startswith((*RELATIONS, "between "), self._at)

    def take_word(self, *words: str) -> str | None:
        """Take the first of these words that stands here."""
        self._skip_blanks()
        for word in words:
            end = self._at + len(word)
            if self.text.startswith(word, self._at) and not _continues_word(self.text, end):
                self._at = end
                return word
        return None

    def take_sign(self, *signs: str) -> str | None:
        """Take the first of these signs that stands here."""
        self._skip_blanks()
        for sign in signs:
            if self.text.startswith(sign, self._at):
                self._at += len(sign)
                return sign
        return None

    def take_relation(self) -> str | None:
        """Take a relation in any spelling; return ``<``, ``<=``, ``>``, ``>=``, ``=`` or ``!=``."""
        found = self.take_sign(*RELATIONS)
        return None if found is None else RELATIONS[found]

    def take_number(self) -> Decimal | None:
        """Take a decimal number, exactly."""
        self._skip_blanks()
        found = _NUMBER.match(self.text, self._at)
        if found is None:
            return None
        self._at = found.end()
        try:
            return Decimal(found[0].replace("−", "-"))
        except InvalidOperation:
            self.fail(f"{found[0]} is not a number")

    def take_name(self, names: Sequence[str]) -> str | None:
        """Take the longest of these names that stands here, or the one in quotes.

        Quotes are those of JSON. A name that equals a word of the language must be quoted.

        Raises:
            ValueError: If the name in quotes is none of them.
        """
        self._skip_blanks()
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
        matches = [name for name in names if self._matches(name)]
        if not matches:
            return None
        longest = max(matches, key=len)
        self._at += len(longest)
        return longest

    def fail_unknown_name(self, names: Sequence[str], kind: str) -> Never:
        """Report that the name here is none of these.

        Args:
            names: The known names; the most similar ones are suggested.
            kind: What they name, such as ``"feature"``.

        Raises:
            ValueError: Always.
        """
        self._skip_blanks()
        end = _END_OF_NAME.search(self.text, self._at)
        name = self.text[self._at : end.start() if end else len(self.text)].strip()
        if not name:
            self.fail(f"expected {'an' if kind[0] in 'aeiou' else 'a'} {kind}; {did_you_mean(name, names)}")
        self.fail(f"unknown {kind} {printable(name)!r}; {did_you_mean(name, names)}")

    def fail(self, problem: str) -> Never:
        """Report a problem and where in the rule it is.

        Raises:
            ValueError: Always.
        """
        rest = self.text[self._at :].strip()
        where = f"at {printable(rest)[:60]!r}" if rest else "at the end"
        raise ValueError(f"{problem} ({where} of the rule {printable(self.text)[:200]!r})")

    def _skip_blanks(self) -> None:
        while self._at < len(self.text) and self.text[self._at].isspace():
            self._at += 1

    def _matches(self, name: str) -> bool:
        if not name or name in KEYWORDS or not self.text.startswith(name, self._at):
            return False
        return not (name[-1].isalnum() and _continues_word(self.text, self._at + len(name)))


def _continues_word(text: str, at: int) -> bool:
    return at < len(text) and (text[at].isalnum() or text[at] == "_")
