"""Gymnasium's spaces as a tree sees them: an observation is a row of named numbers.

Everything here is NumPy on the host; observations of environments in JAX are flat float32 vectors already.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from gymnasium import Space
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from numpy.typing import ArrayLike, NDArray

from ..trees.actions import ActionSpec, BoxActions, DiscreteActions, MultiDiscreteActions
from ..trees.floats import flushed
from ..trees.groups import Group, check_groups, require_one_hot

UNBOUNDED = 1e6
"""Bounds as large as this are ignored: they say nothing about a feature, and exist because a space needs bounds."""

LARGEST = 2.0**63
"""The largest observation that can be trained on: in float32 the squares of larger ones, and so their scale,
overflow."""

Path: TypeAlias = tuple[Any, ...]
"""The place of a space inside another: keys of ``Dict`` and positions of ``Tuple``, from the root."""


class Feature(NamedTuple):
    """One number of an observation.

    Attributes:
        path: The place of its space.
        name: Its name below this path: ``[1, 2]``, ``[0] = 3``.
        low: The lowest value.
        high: The highest value.
        choice: The index of the choice that it is a category of, or None.
        integer: Whether it is a whole number.
    """

    path: Path
    name: str
    low: float
    high: float
    choice: tuple[int, ...] | None = None
    integer: bool = False


@dataclass(frozen=True)
class Features:
    """The F float32 features that an observation space becomes.

    The order is that of `gymnasium.spaces.flatten`: ``Box`` and ``MultiBinary`` in C order, ``Discrete`` and
    ``MultiDiscrete`` one-hot, ``Dict`` by its (sorted) keys, ``Tuple`` by position. float64 numbers, and
    integers beyond 2²⁴, lose their last digits in float32: the tree sees them rounded, always in the same way.

    Attributes:
        space: The observation space.
        names: The names of the features.
        low: The lower bounds; infinite where there are none.
        high: The upper bounds; infinite where there are none.
        groups: Features that are one-hot together.
        integers: Positions of features that are whole numbers and in no group.
    """

    space: Space
    names: tuple[str, ...]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    groups: tuple[Group, ...] = ()
    integers: tuple[int, ...] = ()

    @classmethod
    def of(
        cls,
        space: Space,
        names: Sequence[str] | None = None,
        groups: Sequence[Group] | None = None,
        integers: Sequence[int] = (),
    ) -> Features:
        """Describe a space.

        Bounds that are NaN, too large (`UNBOUNDED`) or the wrong way round are ignored: pruning, which relies on
        bounds, would remove what the environment does visit.

        Args:
            space: The observation space.
            names: Names in place of ``x[0]``, ``camera[1, 2]``, ``weather = 3``.
            groups: Features that are one-hot together; by default those of each ``Discrete`` and ``MultiDiscrete``.
            integers: Positions of features that are whole numbers, besides those of which the space says so.

        Returns:
            The features.

        Raises:
            ValueError: The space is unsupported, or names or groups do not fit.
        """
        features = list(_features(space))
        if not features:
            raise ValueError(f"observation space must have at least one feature, got {space}")
        named = check_names(names, _names(space, features), "feature_names")
        if groups is None:
            groups = _one_hot_groups(features, named)
        grouped = {feature for group in groups for feature in group.features}
        whole = {i for i, feature in enumerate(features) if feature.integer} | set(integers)
        low, high = (flushed(bounds) for bounds in zip(*((f.low, f.high) for f in features), strict=True))
        ordered = ~(low > high)
        return cls(
            space=space,
            names=named,
            groups=check_groups(groups, len(features)),
            integers=tuple(sorted(whole - grouped)),
            low=np.where(ordered & (np.abs(low) < UNBOUNDED), low, np.float32(-np.inf)),
            high=np.where(ordered & (np.abs(high) < UNBOUNDED), high, np.float32(np.inf)),
        )

    def metadata(self) -> dict[str, Any]:
        """Return the fields of a `DecisionTree` that describe its features.

        Returns:
            Keyword arguments of its constructors.
        """
        return {
            "feature_names": self.names,
            "feature_low": self.low,
            "feature_high": self.high,
            "groups": self.groups,
            "integers": self.integers,
        }

    def flatten(self, observation: Any) -> NDArray[np.float32]:
        """Turn one observation, or a batch of them, into features.

        Numbers too small for float32's normal range become zero, as for JAX on the CPU.

        Args:
            observation: The observation; a batch has its leading axes on every array inside, as in Gymnasium's vector
                environments.

        Returns:
            A new array ``[*batch, F]``.

        Raises:
            ValueError: A type, shape or category does not fit the space, and the message says where; or a group is not
                one-hot.
        """
        parts = list(_flatten(self.space, observation, "observation"))
        batch = parts[0].shape[:-1]
        for part in parts:
            if part.shape[:-1] != batch:
                raise ValueError(
                    "all parts of an observation must have the same leading batch axes, "
                    f"got {batch} and {part.shape[:-1]}; give one observation, or stack all parts"
                )
        flat = flushed(np.concatenate(parts, axis=-1))
        require_one_hot(self.groups, flat.reshape(-1, len(self.names)))
        return flat

    def flatten_each(self, observations: Sequence[Any]) -> NDArray[np.float32]:
        """Turn a list of single observations into features.

        Args:
            observations: The observations.

        Returns:
            An array ``[len(observations), F]``.
        """
        if not len(observations):
            return np.zeros((0, len(self.names)), np.float32)
        if isinstance(self.space, Box):
            shapes = {getattr(observation, "shape", None) for observation in observations}
            if shapes == {self.space.shape}:  # at once: a call for each would cost more than a policy does
                return self.flatten(np.stack(observations))
        return np.stack([self.flatten(observation) for observation in observations])


def check_names(names: Sequence[str] | None, default: Sequence[str], what: str) -> tuple[str, ...]:
    """Check the user's names: there must be one for each default, and no two may be equal.

    Args:
        names: The names, or None for the defaults.
        default: The default names.
        what: The name of the argument, for messages.

    Returns:
        The names.

    Raises:
        ValueError: The names break the rule.
    """
    if names is None:
        return tuple(default)
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"{what} must be a sequence of strings, got {names!r}")
    if len(names) != len(default):
        raise ValueError(
            f"{what} must have {len(default)} names, got {len(names)}; the defaults are {_shorten(default)}"
        )
    twice = sorted({name for name in names if list(names).count(name) > 1})
    if twice:
        raise ValueError(f"{what} must differ from each other, got {twice} more than once")
    return tuple(names)


def require_spaces(env: Any) -> None:
    """Check that an environment has its two spaces.

    Args:
        env: The environment.

    Raises:
        ValueError: It lacks one, which the message names.
    """
    for name, like in (("observation_space", "Box(low, high)"), ("action_space", "Discrete(n)")):
        try:
            space = getattr(env, name)
        except AttributeError:
            raise ValueError(
                f"{type(env).__name__} has no {name}: set it in __init__, to a space such as gymnasium.spaces.{like}"
            ) from None
        if not isinstance(space, Space):
            raise ValueError(
                f"the {name} of {type(env).__name__} must be a space such as gymnasium.spaces.{like}, got "
                f"{describe(space)}"
            )


def action_spec(
    space: Space, names: Sequence[str] | None = None, options: Sequence[Sequence[str]] | None = None
) -> ActionSpec:
    """Describe the actions of a space.

    Args:
        space: The action space.
        names: Names of the actions (``Discrete``) or of their components.
        options: Names of the options of each component (``MultiDiscrete``).

    Returns:
        The description.

    Raises:
        ValueError: The space is unsupported, or the names do not fit.
    """
    match space:
        case Discrete():
            spec = DiscreteActions(int(space.n), start=int(space.start))
        case MultiDiscrete() if space.nvec.ndim == 1:
            named = tuple(tuple(part) for part in options or ())
            spec = MultiDiscreteActions(tuple(space.nvec.tolist()), (), named, tuple(space.start.tolist()))
        case Box() if np.issubdtype(space.dtype, np.floating) and np.prod(space.shape) > 0:
            low, high = (tuple(flushed(bound).ravel().tolist()) for bound in (space.low, space.high))
            spec = BoxActions(low, high, space.shape)
        case _:
            raise ValueError(
                f"unsupported action space {space}; supported are Discrete, MultiDiscrete of one axis, "
                "and Box of floats; wrap the environment in gymnasium.wrappers.TransformAction to offer one"
            )
    return replace(spec, names=check_names(names, spec.names, "action_names"))


def native_actions(space: Space, actions: ArrayLike) -> NDArray:
    """Turn a policy's batch of actions into what environments with this space expect.

    Rounding a float64 bound to float32 may have moved an action just past it, so it is clipped again.

    Args:
        space: The action space.
        actions: Categories counted from zero, ``[B]`` for ``Discrete`` and ``[B, k]`` for ``MultiDiscrete``; or
            float32, ``[B, A]`` or ``[B, *space.shape]``.

    Returns:
        Actions ``[B, *space.shape]`` of the space's dtype, counted from its start.

    Raises:
        ValueError: The space is unsupported.
    """
    actions = np.asarray(actions)
    match space:
        case Discrete() | MultiDiscrete():
            return actions.astype(space.dtype) + space.start
        case Box():
            shaped = actions.reshape(len(actions), *space.shape).astype(space.dtype)
            return np.clip(shaped, space.low, space.high)
    raise ValueError(f"unsupported action space {space}")


def _features(space: Space, path: Path = ()) -> Iterator[Feature]:
    match space:
        case Box():
            whole = not np.issubdtype(space.dtype, np.floating)
            for index in np.ndindex(space.shape):
                low, high = float(space.low[index]), float(space.high[index])
                yield Feature(path, _subscript(index), low, high, integer=whole)
        case MultiBinary():
            for index in np.ndindex(space.shape):
                yield Feature(path, _subscript(index), 0, 1, integer=True)
        case Discrete():
            for category in range(int(space.n)):
                yield Feature(path, f" = {space.start + category}", 0, 1, ())
        case MultiDiscrete():
            for index in np.ndindex(space.nvec.shape):
                for category in range(int(space.nvec[index])):
                    name = f"{_subscript(index)} = {space.start[index] + category}"
                    yield Feature(path, name, 0, 1, index)
        case Dict() | Tuple():
            parts = space.spaces.items() if isinstance(space, Dict) else enumerate(space.spaces)
            for key, part in parts:
                yield from _features(part, (*path, key))
        case _:
            raise ValueError(
                f"unsupported observation space {space}; supported are Box, Discrete, MultiBinary, "
                "MultiDiscrete, and Dict and Tuple of these; wrap the environment in "
                "gymnasium.wrappers.TransformObservation to offer one of them"
            )


def _names(space: Space, features: Sequence[Feature]) -> list[str]:
    """Return a name for each feature, and no name twice.

    Keys are joined by dots, ``arm.joint``. Where that spells one name for several features, as the keys ``"arm.joint"``
    and ``"arm"`` → ``"joint"`` do, the spaces concerned are written with their keys in brackets: ``['arm']['joint']``.
    """
    root = () if isinstance(space, Dict) else ("x",)
    in_brackets: set[Path] = set()
    while True:
        names = [_spelled(root, feature, in_brackets) for feature in features]
        count = Counter(names)
        unclear = {feature.path for feature, name in zip(features, names, strict=True) if count[name] > 1}
        if unclear <= in_brackets:
            return names
        in_brackets |= unclear


def _spelled(root: Path, feature: Feature, in_brackets: Set[Path]) -> str:
    if feature.path in in_brackets:
        return "".join([*root, *(f"[{key!r}]" for key in feature.path), feature.name])
    return ".".join(map(str, (*root, *feature.path))) + feature.name


def _one_hot_groups(features: Sequence[Feature], names: Sequence[str]) -> list[Group]:
    """Group the features that one choice became; their names say it all."""
    positions: dict[tuple[Path, tuple[int, ...]], list[int]] = {}
    for position, feature in enumerate(features):
        if feature.choice is not None:
            positions.setdefault((feature.path, feature.choice), []).append(position)
    return [Group("", tuple(of), tuple(names[i] for i in of)) for of in positions.values()]


def _flatten(space: Space, observation: Any, path: str) -> Iterator[NDArray]:
    """Yield the parts of an observation, each ``[*batch, its features]``."""
    match space:
        case Box() | MultiBinary():
            array = _array(observation, "fiub" if isinstance(space, Box) else "iub", space, path)
            shape = space.shape or ()
            yield array.reshape(*array.shape[: array.ndim - len(shape)], math.prod(shape))
        case Discrete():
            yield _one_hot(_array(observation, "iub", space, path), int(space.start), int(space.n), path)
        case MultiDiscrete():
            array = _array(observation, "iub", space, path)
            for index in np.ndindex(space.nvec.shape):
                where = path + _subscript(index)
                yield _one_hot(array[..., *index], int(space.start[index]), int(space.nvec[index]), where)
        case Dict():
            if not isinstance(observation, dict) or observation.keys() != space.spaces.keys():
                got = _keys(observation) if isinstance(observation, dict) else describe(observation)
                raise ValueError(f"{path} must be a dict with the keys {_keys(space.spaces)}, got {got}")
            for key, part in space.spaces.items():
                yield from _flatten(part, observation[key], f"{path}[{key!r}]")
        case Tuple():
            yield from _flatten_tuple(space, observation, path)


def _flatten_tuple(space: Tuple, observation: Any, path: str) -> Iterator[NDArray]:
    listed = isinstance(observation, list) or (isinstance(observation, np.ndarray) and observation.ndim > 0)
    if not (listed or isinstance(observation, tuple)) or len(observation) != len(space.spaces):
        raise ValueError(f"{path} must be a tuple of {len(space.spaces)} parts, got {describe(observation)}")
    for position, (part, value) in enumerate(zip(space.spaces, observation, strict=True)):
        for flat in _flatten(part, value, f"{path}[{position}]"):
            if listed and flat.ndim > 1:  # parts of a batch, or a batch of tuples? A guess might be wrong
                raise ValueError(
                    f"{path} must be a tuple of {len(space.spaces)} parts where it is a batch (a list or an array is "
                    f"one observation), got {describe(observation)}"
                )
            yield flat


def _array(observation: Any, kinds: str, space: Space, path: str) -> NDArray:
    """Check one array against its space: of one of these NumPy kinds, shaped ``[*batch, *space.shape]``.

    Whatever ``space.contains`` takes is taken: a ``Box`` converts what is no array yet to its own dtype, and
    ``MultiBinary`` compares with 0 and 1, whatever the dtype. An empty list is an empty batch.
    """
    shape = space.shape or ()
    try:
        array = np.asarray(observation)
    except ValueError:  # ragged
        array = np.empty((), object)
    if array.shape == (0,) and shape != (0,):
        array = np.zeros((0, *shape), space.dtype)
    if array.dtype.kind not in kinds:
        array = _converted(array, observation, space)
    trailing = array.shape[array.ndim - len(shape) :] if array.ndim >= len(shape) else None
    if array.dtype.kind not in kinds or trailing != shape:
        numbers = "integers" if "f" not in kinds else "real numbers"
        raise ValueError(
            f"{path} must be an array of {numbers} of shape {shape} (or a batch of such, with leading axes), "
            f"got {describe(observation)}; the space is {space}"
        )
    return array


def _converted(array: NDArray, observation: Any, space: Space) -> NDArray:
    """Return the array as its space reads it, or as it is where the space does not read it."""
    if not array.size:
        return array.astype(space.dtype)
    if isinstance(space, MultiBinary) and array.dtype.kind in "fcO" and ((array == 0) | (array == 1)).all():
        return (array == 1).astype(np.int8)
    if isinstance(space, Box) and not isinstance(observation, np.ndarray):
        try:
            numbers = np.asarray(observation, dtype=space.dtype)
        except (ValueError, TypeError, OverflowError):
            return array
        return array if np.isnan(numbers).any() else numbers  # None becomes NaN
    return array


def _one_hot(category: NDArray, start: int, n: int, path: str) -> NDArray[np.bool_]:
    index = category.astype(np.int64) - start
    if ((index < 0) | (index >= n)).any():
        raise ValueError(f"{path} must be a category from {start} to {start + n - 1}, got {category}")
    return np.arange(n) == index[..., None]


def _keys(of: dict[Any, Any]) -> list[Any]:
    return sorted(of, key=str)


def _subscript(index: tuple[int, ...]) -> str:
    return f"[{', '.join(map(str, index))}]" if index else ""


def _shorten(names: Sequence[str], limit: int = 8) -> str:
    return ", ".join(map(repr, names[:limit])) + (", …" if len(names) > limit else "")


def describe(value: Any) -> str:
    """Describe a value for a message: type and value, shortened, and of an array only dtype and shape.

    Args:
        value: The value.

    Returns:
        The description.
    """
    if isinstance(value, np.ndarray):
        return f"{value.dtype} array of shape {value.shape}"
    text = repr(value)
    return f"{type(value).__name__} {text if len(text) <= 60 else text[:57] + '…'}"
