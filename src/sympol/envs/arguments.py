"""Arguments of environments in a form that TOML and JSON can hold, and back without loss.

Booleans, numbers, text, lists and dictionaries stay what they are. Everything else that can be kept is a table with
the key ``$type``: None, tuples, sets, paths, bytes, NumPy's arrays and numbers, dictionaries with other keys than text.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path, PosixPath, WindowsPath
from typing import Any

import numpy as np

_TAG = "$type"
_DEEPEST = 32
_KINDS = "biufUS"
"""NumPy's kinds of dtype whose elements are plain numbers or text."""


class CannotKeep(ValueError):
    """An argument cannot be written down; the message names it."""


def to_plain(value: Any, name: str, depth: int = 0) -> Any:
    """Return an argument as TOML and JSON can hold it.

    Args:
        value: The argument.
        name: Its name, for messages.
        depth: How deep it is inside another argument.

    Returns:
        The same as booleans, numbers, text, lists and dictionaries.

    Raises:
        CannotKeep: It, or a part of it, is of a type that cannot be read back without running code of the user's.
    """
    if depth > _DEEPEST:
        raise CannotKeep(f"{name} is nested more than {_DEEPEST} deep")

    def part(value: Any, where: str) -> Any:
        return to_plain(value, f"{name}{where}", depth + 1)

    kind = type(value)
    if kind in (bool, int, float):
        return value
    if kind is str and _is_utf8(value):
        return value
    if kind is list:
        return [part(item, f"[{i}]") for i, item in enumerate(value)]
    if kind is dict:
        if all(type(key) is str and _is_utf8(key) for key in value) and _TAG not in value:
            return {key: part(item, f"[{key!r}]") for key, item in value.items()}
        items = [[part(key, " (a key)"), part(item, f"[{key!r}]")] for key, item in value.items()]
        return {_TAG: "dict", "items": items}
    if value is None:
        return {_TAG: "None"}
    if kind in (tuple, set, frozenset):
        members = (
            value if kind is tuple else sorted(value, key=lambda member: (str(type(member)), repr(member)))
        )
        return {_TAG: kind.__name__, "items": [part(item, f"[{i}]") for i, item in enumerate(members)]}
    if kind in (Path, PosixPath, WindowsPath) and _is_utf8(str(value)):
        return {_TAG: "path", "value": str(value)}
    if kind is bytes:
        return {_TAG: "bytes", "value": value.hex()}
    if (kind is np.ndarray or isinstance(value, np.generic)) and value.dtype.kind in _KINDS:
        array = np.asarray(value)
        plain = array.ravel().tolist()
        if array.dtype.kind == "S":
            plain = [item.decode("latin-1") for item in plain]
        if array.dtype.kind != "U" or all(map(_is_utf8, plain)):
            return {
                _TAG: "scalar" if isinstance(value, np.generic) else "array",
                "dtype": array.dtype.str,
                "shape": list(array.shape),
                "data": plain,
            }
    raise CannotKeep(f"{name} is of type {kind.__module__}.{kind.__qualname__}")


def from_plain(value: Any) -> Any:
    """Return the argument that `to_plain` wrote.

    Args:
        value: What it wrote.

    Returns:
        The argument.

    Raises:
        ValueError: It is a table with ``$type`` that `to_plain` does not write.
    """
    if isinstance(value, list):
        return [from_plain(item) for item in value]
    if not isinstance(value, Mapping):
        return value
    if _TAG not in value:
        return {key: from_plain(item) for key, item in value.items()}
    try:
        return _tagged(value)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, MemoryError) as error:
        raise ValueError(f"not an argument of an environment: {_short(value)} ({error})") from error


def _tagged(value: Mapping[str, Any]) -> Any:
    match value[_TAG]:
        case "None":
            return None
        case "tuple":
            return tuple(from_plain(value["items"]))
        case "set":
            return set(from_plain(value["items"]))
        case "frozenset":
            return frozenset(from_plain(value["items"]))
        case "dict":
            return {from_plain(key): from_plain(item) for key, item in value["items"]}
        case "path":
            return Path(value["value"])
        case "bytes":
            return bytes.fromhex(value["value"])
        case "array" | "scalar" as kind:
            dtype, shape, data = np.dtype(value["dtype"]), tuple(value["shape"]), list(value["data"])
            if dtype.kind not in _KINDS or math.prod(shape) != len(data):
                raise ValueError(f"{len(data)} elements of dtype {dtype} for the shape {list(shape)}")
            if dtype.kind == "S":
                data = [item.encode("latin-1") for item in data]
            array = np.array(data, dtype).reshape(shape)
            return array[()] if kind == "scalar" else array
    raise ValueError(f"unknown {_TAG} {value[_TAG]!r}")


def _is_utf8(text: str) -> bool:
    return not any("\ud800" <= character <= "\udfff" for character in text)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:79] + "…"
