"""Declare hyperparameters: the default, the rule and the search space of each, in one place.

A field of `Config` is declared with `knob`. The checks, the flags of the command line, the presets' fields, the traced
part of the config and the search spaces follow from that line. Nothing here imports JAX.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import operator
from dataclasses import dataclass
from typing import Any, Literal, SupportsIndex, get_args, get_origin, get_type_hints

import numpy as np


class ConfigError(ValueError):
    """A configuration that cannot be trained; the message names the value, the rule and the remedy."""


@dataclass(frozen=True)
class Range:
    """An interval of numbers to search, both ends included; of integers where both ends are integers.

    Args:
        low: The lower end.
        high: The upper end.
        log: Whether to draw on a logarithmic scale.
    """

    low: float
    high: float
    log: bool = False


@dataclass(frozen=True)
class Knob:
    """The rule of one field of the config.

    Args:
        low: The smallest value allowed, for numbers.
        high: The largest value allowed, for numbers.
        choices: The words allowed; any word if empty.
        only: The policies and algorithms that have the field; all of them if empty.
        traced: Whether the compiled program takes the value as an argument.
        search: What a hyperparameter search draws from, where the field is searched.
    """

    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    traced: bool = False
    search: Range | tuple[Any, ...] | None = None


def knob(
    default: Any,
    *,
    low: float | None = None,
    high: float | None = None,
    only: tuple[str, ...] = (),
    traced: bool = False,
    search: Range | tuple[Any, ...] | None = None,
) -> Any:
    """Declare a field of the config. Its meaning is the string below the declaration.

    Args:
        default: The default value; its type is the type of the field.
        low: The smallest value allowed, for numbers.
        high: The largest value allowed, for numbers.
        only: The policies and algorithms that have the field; all of them if empty. For others it must keep its
            default.
        traced: Whether the compiled program takes the value as an argument, so that one program serves all values and
            `jax.vmap` may map over them. Otherwise another value is another program.
        search: What a hyperparameter search draws from, where the field is searched.

    Returns:
        The dataclass field. The choices of a field of words are those of its `Literal` annotation.
    """
    rule = Knob(low=low, high=high, only=only, traced=traced, search=search)
    return dataclasses.field(default=default, metadata={"knob": rule})


def knobs_of(config: type[Any]) -> dict[str, Knob]:
    """Return the rule of each field of a config class, in the order of declaration."""
    hints = get_type_hints(config)
    rules = {}
    for field in dataclasses.fields(config):
        choices = get_args(hints[field.name]) if get_origin(hints[field.name]) is Literal else ()
        rules[field.name] = dataclasses.replace(field.metadata["knob"], choices=choices)
    return rules


def check(name: str, value: Any, rule: Knob) -> None:
    """Raise ConfigError unless a value that `as_plain` returned is in its range and among its choices."""
    if rule.low is not None and rule.high is not None and not rule.low <= value <= rule.high:
        too_deep = name == "depth" and value > rule.high
        hint = f"; a tree of depth {value} has 2^{value} leaves" if too_deep else ""
        raise ConfigError(f"{name} must be between {rule.low} and {rule.high}, got {value}{hint}")
    if rule.choices and value not in rule.choices:
        raise ConfigError(f"{name} must be one of {', '.join(rule.choices)}, got {value!r}")


def as_plain(name: str, value: object, default: object) -> Any:
    """Convert the value of a field to the type of its default.

    NumPy scalars count as numbers, a whole float such as 1e6 as an integer, and an integer as a float. A bool counts
    as nothing but a bool.

    Args:
        name: The field, for the message.
        value: What was given.
        default: The default of the field.

    Returns:
        The value as a Python bool, int, float, str or tuple of ints.

    Raises:
        ConfigError: The value has another type.
    """
    match default:
        case bool():
            plain, kind = bool(value) if _is_bool(value) else None, "true or false"
        case int():
            plain, kind = whole(value), "a whole number"
        case float():
            plain, kind = _number(value), "a number"
        case tuple():
            widths = tuple(whole(v) for v in value) if isinstance(value, tuple) else (None,)
            plain, kind = None if None in widths else widths, "a list of whole numbers"
        case _:
            plain, kind = str(value) if isinstance(value, str) else None, "a word"
    if plain is None:
        raise ConfigError(f"{name} must be {kind}, got {value!r}")
    return plain


def whole(value: object) -> int | None:
    """Return a whole number as an int, be it 3, ``np.int64(3)`` or 1e6, and None for anything else, bools included."""
    if _is_bool(value):
        return None
    if isinstance(value, SupportsIndex):
        with contextlib.suppress(TypeError):  # an array that holds no single whole number
            return operator.index(value)
    if isinstance(value, float | np.floating) and float(value).is_integer():
        return int(value)
    return None


def _number(value: object) -> float | None:
    if isinstance(value, float | np.floating):
        return None if math.isnan(value) else float(value)
    return whole(value)


def _is_bool(value: object) -> bool:
    return isinstance(value, bool | np.bool_) or getattr(value, "dtype", None) == np.bool_
