"""Lookup of features and actions by name, with the nearest names where there is none."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from .actions import ActionSpec, BoxActions, DiscreteActions, MultiDiscreteActions
from .floats import brief, flushed, printable

if TYPE_CHECKING:
    from jaxtyping import Float32

    from .base import BaseTree

Action: TypeAlias = str | int | float | Sequence[Any] | np.ndarray
"""An action as people give it: see `action_of`."""

_UNIT = re.compile(r"(.*\S)\s*\([^()]*\)", re.DOTALL)
_MOST_COMPARED, _LONGEST_COMPARED = 1000, 200
"""Names, and their characters, among which a similar one is looked for: it takes time in proportion to the square."""

SURE = 0.99
"""The probability at a leaf of an action that was written there by hand; the others share the rest."""


def did_you_mean(name: str, names: Sequence[str]) -> str:
    """Offer the names most like one that is none: ``did you mean 'push left'?``, or all of a few."""
    known = {printable(one).lower(): printable(one) for one in names[:_MOST_COMPARED]}
    near = [
        brief(known[match]) for match in difflib.get_close_matches(name.lower()[:_LONGEST_COMPARED], known)
    ]
    if near:
        return f"did you mean {' or '.join(near)}?"
    some = ", ".join(brief(one) for one in list(known.values())[:8])
    return f"there are {some}{', …' if len(known) > 8 else ''}"


def without_units(names: Sequence[str]) -> Mapping[str, str]:
    """Return the names by their forms without the unit at their end: ``{"pole angle": "pole angle (rad)"}``.

    A form that two names share, or that is another name in full, is left out.
    """
    short = [(found[1], name) for name in names if (found := _UNIT.fullmatch(name))]
    called = Counter((*names, *(form for form, _ in short)))
    return {form: name for form, name in short if called[form] == 1}


def position(name: str, names: Sequence[str], what: str) -> int:
    """Return where a name is among these, as it is, as it is printed, or without the unit that it ends in.

    Raises:
        ValueError: if it is none of them, or more than one is called so.
    """
    found = [i for i, one in enumerate(names) if one == name]
    found = found or [i for i, one in enumerate(names) if printable(one).strip() == name.strip()]
    if not found and (in_full := without_units(names).get(name.strip())) is not None:
        found = [i for i, one in enumerate(names) if one == in_full]
    if not found:
        raise ValueError(f"unknown {what} {brief(name)}; {did_you_mean(name, names)}")
    if len(found) > 1:
        raise ValueError(
            f"{len(found)} of the names are {brief(name)}, as {what}s {brief(found)}: give its number"
        )
    return found[0]


def feature_position(tree: BaseTree, feature: str | int) -> int:
    """Return the position of a feature in an observation, given by name or by that position.

    Raises:
        ValueError: if there is none, or several are called so.
        TypeError: if it is neither a name nor a whole number.
    """
    if isinstance(feature, str):
        return position(feature, tree.feature_names, "feature")
    where = _whole(feature, "a feature")
    if not 0 <= where < tree.n_features:
        raise ValueError(f"a feature must be from 0 to {tree.n_features - 1}, got {where}")
    return where


def action_of(actions: ActionSpec, action: Action) -> np.ndarray:
    """Return an action as `DecisionTree.predict` does.

    A discrete action is a name or a number; several components are as many options, each a name or a number; a
    continuous one is its numbers, in the space's shape or flat, or one number where it has one.

    Raises:
        ValueError: if it is none of the space's.
        TypeError: if it is of another kind.
    """
    if isinstance(actions, DiscreteActions):
        return np.int64(_option(action, actions.names, actions.start, "action"))  # pyright: ignore[reportReturnType]
    if isinstance(actions, MultiDiscreteActions):
        given = (
            list(action) if isinstance(action, Sequence | np.ndarray) and not isinstance(action, str) else []
        )
        if len(given) != len(actions.nvec):
            raise ValueError(
                f"an action must have {len(actions.nvec)} options, of {', '.join(map(repr, actions.names))}, "
                f"got {action!r}"
            )
        parts = zip(given, actions.options, actions.start, actions.names, strict=True)
        return np.array(
            [_option(one, options, start, f"option of {name!r}") for one, options, start, name in parts],
            np.int64,
        )
    return _numbers(actions, action)


def leaf_value(actions: ActionSpec, action: Action) -> Float32[np.ndarray, " outputs"]:
    """Return what a leaf holds whose action is this one.

    A continuous action is its own mean. Of discrete ones this one has the probability `SURE`, and the others share
    what is left: clearly the action, and not so surely that training on could not change it.

    Raises:
        ValueError, TypeError: as `action_of` does.
    """
    chosen = action_of(actions, action)
    if isinstance(actions, BoxActions):
        return chosen.ravel()
    sizes = (actions.n,) if isinstance(actions, DiscreteActions) else actions.nvec
    columns = np.atleast_1d(chosen - np.array(actions.start))
    return np.concatenate([_sure(size, int(column)) for size, column in zip(sizes, columns, strict=True)])


def _sure(size: int, column: int) -> Float32[np.ndarray, " size"]:
    logits = np.full(size, np.log((1 - SURE) / max(size - 1, 1)), np.float32)
    logits[column] = np.log(SURE)
    return logits


def _option(given: Any, names: Sequence[str], start: int, what: str) -> int:
    if isinstance(given, str):
        return start + position(given, names, what)
    number = _whole(given, f"an {what}")
    if not start <= number < start + len(names):
        raise ValueError(f"an {what} must be from {start} to {start + len(names) - 1}, got {number}")
    return number


def _numbers(actions: BoxActions, action: Action) -> Float32[np.ndarray, "*shape"]:
    raw = np.asarray(action)
    if raw.dtype.kind not in "fiu":
        raise TypeError(f"a continuous action is numbers, got {action!r}")
    if raw.size != actions.n_outputs or raw.shape not in ((), (raw.size,), actions.shape):
        raise ValueError(f"an action must have the shape {list(actions.shape)}, got {list(raw.shape)}")
    chosen = flushed(raw).reshape(actions.shape)
    if not np.isfinite(chosen).all() or (actions.decide(chosen.reshape(1, -1))[0] != chosen).any():
        raise ValueError(
            f"an action must be from {list(actions.low)} to {list(actions.high)}, got {action!r}"
        )
    return chosen


def _whole(given: Any, what: str) -> int:
    if isinstance(given, bool | np.bool_) or np.ndim(given) or not isinstance(given, int | np.integer):
        raise TypeError(f"{what} is a name or a whole number, got {given!r}")
    return int(given)
