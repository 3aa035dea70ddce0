"""Compare Python objects by all that tells them apart, to prove that a copy of an environment is the same one.

Two environments made in the same way need not be equal: an attribute may have been set afterwards, a wrapper may have
gathered statistics. Their whole state is compared, attribute by attribute. What cannot be compared counts as different.
"""

from __future__ import annotations

import math
import pickle
import random
import re
from collections import deque
from collections.abc import Iterator
from functools import cached_property, partial
from pathlib import PurePath
from types import FunctionType, MemberDescriptorType, MethodType
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import (
    HumanRendering,
    OrderEnforcing,
    PassiveEnvChecker,
    RecordEpisodeStatistics,
    RenderCollection,
    TimeLimit,
)

WITHOUT_EFFECT = (
    OrderEnforcing,
    PassiveEnvChecker,
    HumanRendering,
    RenderCollection,
    RecordEpisodeStatistics,
)
"""Wrappers that change nothing in what is observed or earned."""
_DRAWING = "pygame"
"""The package of what is there only once an environment has been drawn."""

_ADDRESS = re.compile("0x[0-9a-fA-F]+")


def are_equal(a: Any, b: Any) -> bool:
    """Return whether two objects have the same type and the same state, through all that they refer to.

    Environments are equal if their wrappers and all attributes are, apart from wrappers `WITHOUT_EFFECT`, from what
    they know of how they were made (``spec``), from what they draw with, and from how often a time limit is imposed in
    the same place.

    Args:
        a: An object.
        b: Another object.

    Returns:
        True if nothing tells them apart; False if something does, or if they cannot be compared.
    """
    try:
        return _Comparison().equal(a, b)
    except Exception:  # an attribute that cannot be read, or a graph too deep: nothing is proven
        return False


def step_limit(env: gymnasium.Env) -> int | None:
    """Return the smallest number of steps to which a `TimeLimit` wrapper of the environment cuts episodes.

    Args:
        env: The environment.

    Returns:
        The limit, or None if there is none.
    """
    limits = [layer._max_episode_steps for layer in _layers(env) if isinstance(layer, TimeLimit)]
    return min(limits, default=None)


def _limits(env: gymnasium.Env) -> dict[int, int]:
    """Return the smallest time limit by its place: how many wrappers are outside that need not step once in a step."""
    found: dict[int, int] = {}
    outside = 0
    for layer in _layers(env):
        if type(layer) is TimeLimit:
            found[outside] = min(layer._max_episode_steps, found.get(outside, layer._max_episode_steps))
        elif not isinstance(
            layer,
            (gymnasium.ObservationWrapper, gymnasium.ActionWrapper, gymnasium.RewardWrapper, *WITHOUT_EFFECT),
        ):
            outside += 1
    return found


def _draws(value: object) -> bool:
    home = getattr(type(value), "__module__", "")  # SWIG's types have none
    return home.partition(".")[0] == _DRAWING


def _layers(env: Any) -> Iterator[Any]:
    """Yield the wrappers of an environment from the outermost to the innermost, then the environment itself."""
    while isinstance(env, gymnasium.Wrapper):
        yield env
        env = env.env
    yield env


class _Comparison:
    """One comparison: it remembers the pairs under way, because objects refer to each other in circles."""

    def __init__(self) -> None:
        self._pairs: dict[tuple[Any, Any], tuple[Any, Any]] = {}

    def equal(self, a: Any, b: Any) -> bool:
        if a is b:
            return True
        are_envs = isinstance(a, gymnasium.Env) and isinstance(b, gymnasium.Env)
        if type(a) is not type(b) and not are_envs:
            return False
        pair = id(a), id(b)
        if pair in self._pairs:
            return True
        self._pairs[pair] = a, b  # kept alive, or a later object could have the same id
        return self._equal(a, b) and self._equal_extras(a, b)

    def _equal_extras(self, a: Any, b: Any) -> bool:
        """Compare what a container has besides its members."""
        if not isinstance(a, dict | list | tuple | deque | set | frozenset | str | bytes | int | float):
            return True
        extras = (
            [getattr(x, name, None) for name in ("__dict__", "maxlen", "default_factory")] for x in (a, b)
        )
        return all(map(self.equal, *extras))

    def _equal(self, a: Any, b: Any) -> bool:
        match a:
            case float():
                return a == b or (math.isnan(a) and math.isnan(b))
            case bool() | int() | complex() | str() | bytes() | range() | slice() | PurePath() | np.dtype():
                return a == b
            case set() | frozenset() | gymnasium.Space():
                return a == b
            case np.ndarray() | np.generic():
                return self._equal_arrays(np.asarray(a), np.asarray(b))
            case dict():
                return list(a) == list(b) and all(self.equal(a[key], b[key]) for key in a)
            case list() | tuple() | deque():
                return len(a) == len(b) and all(map(self.equal, a, b))
            case np.random.Generator():
                return self.equal(a.bit_generator.state, b.bit_generator.state)
            case np.random.RandomState():
                return self.equal(a.get_state(), b.get_state())
            case random.Random():
                return a.getstate() == b.getstate()
            case FunctionType():
                return a.__code__ == b.__code__ and self.equal(_parts_of_function(a), _parts_of_function(b))
            case MethodType():
                return a.__func__ is b.__func__ and self.equal(a.__self__, b.__self__)
            case partial():
                return self.equal((a.func, a.args, a.keywords), (b.func, b.args, b.keywords))
            case type():
                return False
            case EnvSpec():
                return True  # how it was made, and not what became of it
            case gymnasium.Env():
                return self._equal_envs(a, b)
        return self._equal_attributes(a, b)

    def _equal_arrays(self, a: np.ndarray, b: np.ndarray) -> bool:
        if a.shape != b.shape or a.dtype != b.dtype:
            return False
        if a.dtype == object:
            return all(map(self.equal, a.ravel(), b.ravel()))
        return np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")

    def _equal_envs(self, a: gymnasium.Env, b: gymnasium.Env) -> bool:
        if _limits(a) != _limits(b):
            return False
        ours, theirs = (
            [e for e in _layers(env) if type(e) not in (TimeLimit, *WITHOUT_EFFECT)] for env in (a, b)
        )
        return len(ours) == len(theirs) and all(
            type(x) is type(y) and self._equal_attributes(x, y, but=("env", "_cached_spec", "spec"))
            for x, y in zip(ours, theirs, strict=True)
        )

    def _equal_attributes(self, a: Any, b: Any, but: tuple[str, ...] = ()) -> bool:
        """Compare objects of any other class: by their attributes, or else by what a pickle would hold of them."""
        slots = _slots(a)
        if hasattr(a, "__dict__") or slots:
            ours, theirs = ({k: v for k, v in _attributes(x, slots).items() if k not in but} for x in (a, b))
            drawing = {k for x in (ours, theirs) for k, v in x.items() if _draws(v)}
            ours, theirs = ({k: v for k, v in x.items() if k not in drawing} for x in (ours, theirs))
            if type(ours.get("this")).__name__ == "SwigPyObject":
                return _description(a) == _description(b)
            only_one = {name for name in ours.keys() ^ theirs.keys() if not _is_derived(type(a), name)}
            if only_one or not all(
                self.equal(ours[name], theirs[name]) for name in ours.keys() & theirs.keys()
            ):
                return False
            if not _has_more_than(slots, type(a)):
                return True
        return pickle.dumps(a) == pickle.dumps(b)


def _description(value: Any) -> str:
    """Return what an object wrapped by SWIG says of itself, without addresses."""
    text = repr(value)
    if text.startswith("<"):  # the representation that SWIG gives by itself says nothing
        raise TypeError(f"{type(value)} does not show its state")
    return _ADDRESS.sub("", text)


def _parts_of_function(function: FunctionType) -> tuple[Any, ...]:
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return function.__defaults__, function.__kwdefaults__, cells, function.__dict__


def _slots(value: Any) -> list[str]:
    return [
        name
        for kind in type(value).__mro__
        for name in vars(kind).get("__slots__", ())
        if isinstance(vars(kind).get(name), MemberDescriptorType)
    ]


def _attributes(value: Any, slots: list[str]) -> dict[str, Any]:
    return {**getattr(value, "__dict__", {}), **{n: getattr(value, n) for n in slots if hasattr(value, n)}}


def _is_derived(kind: type, name: str) -> bool:
    """Return whether an attribute is a cached property, which one object may have been asked for and another not."""
    return any(isinstance(vars(one).get(name), cached_property) for one in kind.__mro__)


def _has_more_than(slots: list[str], kind: type) -> bool:
    """Return whether objects of a class hold memory besides their attributes, as those of a class written in C do."""
    special = [name for name in ("__dict__", "__weakref__") if hasattr(kind, name)]
    names = [f"slot_{i}" for i in range(len(slots))]
    return kind.__basicsize__ != type("Plain", (), {"__slots__": [*special, *names]}).__basicsize__
