"""Readable ASCII for characters that a terminal's encoding lacks, as in the C locale."""

from __future__ import annotations

import codecs
import io
import sys
import unicodedata

_READABLE = "sympol.readable"
"""Name of the codecs error handler that replaces such characters."""
_IN_ASCII = {
    **{
        "≤": "<=",
        "≥": ">=",
        "≠": "!=",
        "±": "+/-",
        "−": "-",
        "–": "-",
        "—": "-",
        "…": "...",
        "·": "*",
        "×": "x",
    },
    **{"→": "->", "←": "<-", "↑": "^", "↓": "v", "²": "^2", "³": "^3", "°": " deg", "√": "sqrt", "∞": "inf"},
    **{"⁄": "/", "ß": "ss"},
    **{"✓": "ok", "✗": "FAILS", "○": "o", "‘": "'", "’": "'", "“": '"', "”": '"'},
}


def _in_ascii(character: str) -> str:
    """Return a character in readable ASCII: ``<=``, ``theta``, ``e`` for é, or its number."""
    if character in _IN_ASCII:
        return _IN_ASCII[character]
    kind, *words = unicodedata.name(character, "none").split()
    if kind == "BOX":  # DRAWINGS LIGHT VERTICAL AND RIGHT; a listing drawn in these is read again from_text
        return "+" if "AND" in words else "|" if "VERTICAL" in words else "-"
    if kind == "BRAILLE":  # of which rich makes its spinner
        return "."
    if kind == "GREEK" and "LETTER" in words[:-1]:
        letter = words[words.index("LETTER") + 1].lower()
        return letter.capitalize() if words[0] == "CAPITAL" else letter
    decomposed = unicodedata.normalize("NFKD", character)
    if decomposed != character:
        return "".join(map(_in_ascii, decomposed))
    if character.isascii() or unicodedata.combining(character):
        return character if character.isascii() else ""
    return character.encode("ascii", "backslashreplace").decode()


def _readable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_in_ascii, error.object[error.start : error.end])), error.end


codecs.register_error(_READABLE, _readable)


def write_readable_ascii() -> None:
    """Make the standard streams write readable ASCII for characters that their encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_READABLE)
