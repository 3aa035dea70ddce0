"""Whole numbers as people write them: ``200000``, ``200k``, ``1.5M``, ``1e6``, ``1_000_000``, ``1,000,000``."""

from __future__ import annotations

import re
from decimal import Decimal

SUFFIXES = {"": 0, "k": 3, "K": 3, "M": 6, "G": 9}
"""The power of ten that a letter stands for; ``m`` is none of them, as it means minutes where a time may stand."""

NUMBER = r"[+-]?(?:\d{1,3}(?:,\d{3})+|\d+(?:_\d+)*)(?:\.\d+)?(?:[eE][+-]?\d{1,4})?"
"""A number in digits, as a regular expression."""

_LONGEST = 30
"""Numbers of more digits are refused, as nothing is counted that far."""


def parse_count(text: str) -> int:
    """Read a whole number, exactly: no digit is lost to floating point.

    Args:
        text: The number, with an exponent or one of the `SUFFIXES` if need be.

    Returns:
        The number.

    Raises:
        ValueError: It is no number, or not a whole one.
    """
    match = re.fullmatch(rf"\s*({NUMBER})\s*([{''.join(SUFFIXES)}]?)\s*", text, re.ASCII)
    if match is None:
        hint = f"; a million is {text[:-1]}M" if re.fullmatch(rf"{NUMBER}m", text, re.ASCII) else ""
        raise ValueError(f"must be a whole number, such as 200000, 200k, 1M or 1e6, got {text!r}{hint}")
    number = Decimal(match[1].replace(",", "").replace("_", "")).scaleb(SUFFIXES[match[2]])
    if number and number.adjusted() >= _LONGEST:
        raise ValueError(f"must be a whole number of at most {_LONGEST} digits, got {text!r}")
    if number != number.to_integral_value():
        raise ValueError(f"must be a whole number, got {text!r}, which is {number:f}")
    return int(number)
