"""JSON of plain values, in lines that a version control system can compare."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Return a value as JSON gives it back: lists for tuples, Python's numbers for NumPy's, "inf" for infinity.

    Args:
        value: Numbers, text, None, and lists, arrays and mappings of these.

    Returns:
        The value made of dictionaries, lists, numbers, text and None.

    Raises:
        ValueError: A number is NaN, or a part has another type.
    """
    match value:
        case Mapping():
            return {str(key): plain(part) for key, part in value.items()}
        case str() | bool() | None | int():
            return value
        case list() | tuple() | np.ndarray():
            return [plain(part) for part in value]
        case np.generic():
            return plain(value.item())
        case float() if math.isnan(value):
            raise ValueError("a config or note must not be NaN: JSON has no such number; leave it out")
        case float():
            return value if math.isfinite(value) else str(value)
    raise ValueError(
        f"a config or note must be of plain values, got {value!r} of type {type(value).__name__}; write it as text"
    )


def rounded(value: Any, digits: int) -> Any:
    """Round all numbers in nested lists and mappings to ``digits`` significant digits."""
    if isinstance(value, Mapping):
        return {key: rounded(part, digits) for key, part in value.items()}
    if isinstance(value, Sequence):
        return [rounded(part, digits) for part in value]
    if value is None:
        return None
    short = float(f"{value:.{digits}g}")
    return int(short) if short.is_integer() else short


def dumps(fields: Mapping[str, Any]) -> str:
    """Return JSON with a line for each field, and for each element of a field that holds lists or mappings."""
    return (
        "{\n"
        + ",\n".join(f" {json.dumps(name)}: {_lines(value)}" for name, value in fields.items())
        + "\n}\n"
    )


def _lines(value: Any) -> str:
    if isinstance(value, Mapping) and value:
        inner = [f"{json.dumps(key)}: {json.dumps(value[key], allow_nan=False)}" for key in sorted(value)]
        return "{\n  " + ",\n  ".join(inner) + "\n }"
    if isinstance(value, Sequence) and value and isinstance(value[0], list | tuple | dict):
        return "[\n  " + ",\n  ".join(json.dumps(row, allow_nan=False) for row in value) + "\n ]"
    return json.dumps(value, allow_nan=False)
