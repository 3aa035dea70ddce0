"""Dataclasses as JSON: one declared schema for both sides of a file, or of a message between processes.

The fields of a dataclass and their types are the schema. What `to_fields` writes `from_fields` reads; a field that is
unknown, missing or of another type is refused by its name. A class whose fields had other names in files that are
still to be read lists them in ``FORMER_NAMES``, former name to present name.
"""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from ..trees import DecisionTree
from .json_io import plain

T = TypeVar("T")


def to_fields(record: Any) -> dict[str, Any]:
    """Return the fields of a dataclass as JSON holds them.

    Args:
        record: An instance of a dataclass; its fields are plain values, paths, trees and other dataclasses, also in
            tuples and mappings.

    Returns:
        A value for each field, by name.

    Raises:
        ValueError: A value that JSON cannot hold.
    """
    return {part.name: _to_json(getattr(record, part.name)) for part in fields(record)}


def from_fields(cls: type[T], content: Any) -> T:
    """Make a dataclass of the fields that `to_fields` returned.

    Args:
        cls: The dataclass; its annotations say what each field may be.
        content: What JSON gave back: an object with exactly the fields of the class.

    Returns:
        An instance of the class.

    Raises:
        ValueError: A field that is unknown, missing or of another type; or the class refuses the values.
    """
    if not isinstance(content, Mapping):
        raise ValueError(f"{cls.__name__} must be an object, got {content!r:.60}")
    hints, values = _hints(cls), renamed(cls, content)
    for words, names in (
        ("unknown", values.keys() - hints.keys()),
        ("missing", hints.keys() - values.keys()),
    ):
        if names:
            raise ValueError(
                f"{cls.__name__} has {words} fields {', '.join(sorted(names))}; its fields are {', '.join(hints)}"
            )
    return cls(**{name: _from_json(hints[name], values[name], name) for name in hints})


def renamed(cls: type, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields under their present names.

    Args:
        cls: A class with ``FORMER_NAMES``, or without.
        content: The fields by present or former names.

    Returns:
        The same values by present names.
    """
    former = getattr(cls, "FORMER_NAMES", {})
    return {former.get(name, name): value for name, value in content.items()}


def _to_json(value: Any) -> Any:
    match value:
        case DecisionTree():
            return json.loads(value.to_json())
        case Path():
            return str(value)
        case Mapping():
            return {str(key): _to_json(part) for key, part in value.items()}
        case tuple() | list():
            return [_to_json(part) for part in value]
    return to_fields(value) if is_dataclass(value) else plain(value)


@cache
def _hints(cls: type) -> dict[str, Any]:
    hints = get_type_hints(cls)
    return {part.name: hints[part.name] for part in fields(cls) if part.init}  # pyright: ignore[reportArgumentType]


def _from_json(hint: Any, value: Any, name: str) -> Any:
    """Return a value as its annotation says, converted from what JSON has instead."""
    origin, inner = get_origin(hint) or hint, get_args(hint)
    if hint is Any:
        return value
    if origin in (types.UnionType, Union):
        [other] = [one for one in inner if one is not type(None)]
        return None if value is None else _from_json(other, value, name)
    if hint is DecisionTree:
        return DecisionTree.from_json(json.dumps(value))
    if is_dataclass(hint):
        return from_fields(hint, value)  # pyright: ignore[reportArgumentType]
    if origin is tuple and isinstance(value, list):
        return tuple(_from_json(inner[0], part, name) for part in value)
    if origin in (Mapping, dict) and isinstance(value, Mapping):
        return {_PLAIN[inner[0]][1](key): _from_json(inner[1], part, name) for key, part in value.items()}
    if origin in _PLAIN:
        fits, convert = _PLAIN[origin]
        if isinstance(value, fits) and (origin is bool or not isinstance(value, bool)):
            return convert(value)
    raise ValueError(f"{name} must be of type {getattr(hint, '__name__', hint)}, got {value!r:.60}")


_PLAIN: dict[Any, tuple[Any, Callable[[Any], Any]]] = {
    str: (str, str),
    bool: (bool, bool),
    int: (int, int),
    float: (int | float, float),
    Path: (str, Path),
}
