"""Action specifications: the meaning of a tree's outputs, one class for each kind of action space.

| class | outputs | deterministic action |
|---|---|---|
| `DiscreteActions` | n logits | the most likely action, an int64 |
| `MultiDiscreteActions` | the logits of all components in turn | the most likely option of each, int64 |
| `BoxActions` | the mean | the mean, clipped to the bounds, float32 in the space's shape |

Logits are log-probabilities up to a constant. Between equally likely actions the lowest wins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, final

import numpy as np

from .floats import flushed, number, printable

if TYPE_CHECKING:
    from jaxtyping import Float, Float32, Int64
    from numpy.typing import ArrayLike


def _named(names: Sequence[str], defaults: Sequence[str], what: str) -> tuple[str, ...]:
    """Return the names, or defaults where there are none. Raises ValueError for a wrong number of names."""
    names = tuple(names) or tuple(defaults)
    if len(names) != len(defaults) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"expected {len(defaults)} names of {what}, got {names!r}")
    return names


def _softmax(logits: Float32[np.ndarray, "batch n"]) -> Float[np.ndarray, "batch n"]:
    weights = np.exp(logits.astype(np.float64) - logits.max(axis=1, keepdims=True))
    return weights / weights.sum(axis=1, keepdims=True)


@final
@dataclass(frozen=True)
class DiscreteActions:
    """A choice of one of n actions, numbered from ``start``.

    Args:
        n: The number of actions, at least 1.
        names: Their names; ``action 0``, ``action 1``, … by default.
        start: The number of the first action.

    Raises:
        ValueError: If there is no action, or not one name for each.
    """

    n: int
    names: tuple[str, ...] = ()
    start: int = 0

    def __post_init__(self) -> None:
        """Fill in the defaults and check."""
        if self.n < 1:
            raise ValueError(f"a discrete action space has at least one action, got n={self.n}")
        object.__setattr__(self, "n", int(self.n))
        object.__setattr__(self, "start", int(self.start))
        defaults = [f"action {self.start + i}" for i in range(self.n)]
        object.__setattr__(self, "names", _named(self.names, defaults, "actions"))

    @property
    def n_outputs(self) -> int:
        """The number of outputs of a tree."""
        return self.n

    def split(self, values: Float32[np.ndarray, "batch outputs"]) -> list[Float32[np.ndarray, "batch n"]]:
        """Split logits by component, of which there is one.

        Args:
            values: The outputs of leaves, ``[batch, outputs]``.

        Returns:
            The same array, alone in a list.
        """
        return [values]

    def decide(self, values: Float32[np.ndarray, "batch outputs"]) -> Int64[np.ndarray, " batch"]:
        """Return the deterministic action for each row of outputs.

        Args:
            values: What the tree outputs, [batch, outputs].

        Returns:
            Actions as the environment takes them, [batch, *action].
        """
        return np.argmax(values, axis=1) + np.int64(self.start)

    def probabilities(self, values: Float32[np.ndarray, "batch outputs"]) -> Float[np.ndarray, "batch n"]:
        """Return the probability of each action.

        Args:
            values: Logits, [batch, n].

        Returns:
            Probabilities in float64, [batch, n].
        """
        return _softmax(values)

    def words(self, action: ArrayLike, digits: int | None = None) -> tuple[str, ...]:
        """Describe an action: ``("push left",)``.

        Args:
            action: An action as `decide` returns it.
            digits: Significant digits of numbers; as many as needed by default.

        Returns:
            One text for each component.
        """
        return (printable(self.names[int(np.asarray(action)) - self.start]),)


@final
@dataclass(frozen=True)
class MultiDiscreteActions:
    """Several discrete choices at once; component k has ``nvec[k]`` options, numbered from ``start[k]``.

    Args:
        nvec: The number of options of each component.
        names: The names of the components; ``action[0]``, … by default.
        options: The names of the options of each component; their numbers by default.
        start: The number of the first option of each component; 0 by default.

    Raises:
        ValueError: If a component has no option, or numbers of names do not agree.
    """

    nvec: tuple[int, ...]
    names: tuple[str, ...] = ()
    options: tuple[tuple[str, ...], ...] = ()
    start: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Fill in the defaults and check."""
        nvec = tuple(int(n) for n in self.nvec)
        start = tuple(int(s) for s in self.start) or (0,) * len(nvec)
        options = tuple(self.options) or ((),) * len(nvec)
        if not nvec or min(nvec) < 1:
            raise ValueError(f"every component needs at least one option, got nvec={nvec}")
        if not len(start) == len(options) == len(nvec):
            raise ValueError(
                f"expected start and options of {len(nvec)} components, got {start}, {options!r}"
            )
        object.__setattr__(self, "nvec", nvec)
        object.__setattr__(self, "start", start)
        names = [f"action[{k}]" for k in range(len(nvec))]
        object.__setattr__(self, "names", _named(self.names, names, "components"))
        numbered = [[str(s + i) for i in range(n)] for n, s in zip(nvec, start, strict=True)]
        named = (_named(o, d, "options") for o, d in zip(options, numbered, strict=True))
        object.__setattr__(self, "options", tuple(named))

    @property
    def n_outputs(self) -> int:
        """The number of outputs of a tree."""
        return sum(self.nvec)

    def split(self, values: Float32[np.ndarray, "batch outputs"]) -> list[Float32[np.ndarray, "batch n"]]:
        """Split logits [batch, outputs] by component.

        Args:
            values: The outputs of leaves, ``[batch, outputs]``.

        Returns:
            One array ``[batch, options]`` for each component.
        """
        return np.split(values, np.cumsum(self.nvec)[:-1], axis=1)

    def decide(self, values: Float32[np.ndarray, "batch outputs"]) -> Int64[np.ndarray, "batch components"]:
        """Return the deterministic action for each row of outputs.

        Args:
            values: What the tree outputs, [batch, outputs].

        Returns:
            Actions as the environment takes them, [batch, *action].
        """
        chosen = [np.argmax(logits, axis=1) for logits in self.split(values)]
        return np.stack(chosen, axis=1) + np.array(self.start, dtype=np.int64)

    def probabilities(
        self, values: Float32[np.ndarray, "batch outputs"]
    ) -> tuple[Float[np.ndarray, "batch n"], ...]:
        """Return the probability of each option of each component.

        Args:
            values: Logits, [batch, outputs].

        Returns:
            Probabilities in float64, an array [batch, options] for each component.
        """
        return tuple(_softmax(logits) for logits in self.split(values))

    def words(self, action: ArrayLike, digits: int | None = None) -> tuple[str, ...]:
        """Describe an action, component by component: ``("gas: on", "steer: left")``.

        Args:
            action: An action as `decide` returns it.
            digits: Significant digits of numbers; as many as needed by default.

        Returns:
            One text for each component.
        """
        chosen = (np.asarray(action) - np.array(self.start)).tolist()
        return tuple(
            f"{printable(name)}: {printable(options[option])}"
            for name, options, option in zip(self.names, self.options, chosen, strict=True)
        )


@final
@dataclass(frozen=True)
class BoxActions:
    """A float32 array within bounds.

    Bounds, names and std hold one entry for each number of the action, in C order.

    Args:
        low: Lower bounds, or one for all.
        high: Upper bounds, or one for all.
        shape: The shape of an action.
        names: The names of its numbers; ``action[0]``, … by default.
        std: The standard deviation of the policy's noise, the same at every leaf; None without noise.

    Raises:
        ValueError: If sizes do not agree, a lower bound exceeds its upper bound, or std is negative or infinite.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    shape: tuple[int, ...]
    names: tuple[str, ...] = ()
    std: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Fill in the defaults and check."""
        shape = tuple(int(length) for length in self.shape)
        size = math.prod(shape)
        if size < 1 or min(shape, default=1) < 1:
            raise ValueError(f"a continuous action needs at least one number, got shape {shape}")
        object.__setattr__(self, "shape", shape)
        for field in ("low", "high") if self.std is None else ("low", "high", "std"):
            numbers = flushed(getattr(self, field))
            if numbers.size not in (1, size):
                raise ValueError(f"{field} has {numbers.size} numbers, but the shape {shape} holds {size}")
            object.__setattr__(self, field, tuple(np.broadcast_to(numbers.ravel(), size).tolist()))
        if not all(low <= high for low, high in zip(self.low, self.high, strict=True)):
            raise ValueError(f"low must not exceed high, got low={self.low}, high={self.high}")
        if self.std is not None and not all(0 <= std < math.inf for std in self.std):
            raise ValueError(f"std must be finite and not negative, got {self.std}")
        defaults = ["action"] if size == 1 else [f"action[{i}]" for i in range(size)]
        object.__setattr__(self, "names", _named(self.names, defaults, "numbers of an action"))

    @property
    def n_outputs(self) -> int:
        """The number of outputs of a tree."""
        return len(self.low)

    def decide(self, values: Float32[np.ndarray, "batch outputs"]) -> Float32[np.ndarray, "batch ..."]:
        """Return the deterministic action for each row of outputs.

        Args:
            values: What the tree outputs, [batch, outputs].

        Returns:
            Actions as the environment takes them, [batch, *action].
        """
        clipped = np.clip(values, np.array(self.low, np.float32), np.array(self.high, np.float32))
        return clipped.reshape(len(values), *self.shape)

    def probabilities(self, values: Float32[np.ndarray, "batch outputs"]) -> tuple[()]:
        """Raise TypeError: a continuous action has a density, not a table of probabilities.

        Args:
            values: The outputs of leaves, ``[batch, outputs]``.

        Returns:
            Nothing; it always raises.

        Raises:
            TypeError: Continuous actions have no probabilities.
        """
        raise TypeError("continuous actions have no table of probabilities; read predict() and actions.std")

    def words(self, action: ArrayLike, digits: int | None = None) -> tuple[str, ...]:
        """Describe an action, number by number, with ``digits`` significant digits: ``("torque = 0.53",)``.

        Args:
            action: An action as `decide` returns it.
            digits: Significant digits of numbers; as many as needed by default.

        Returns:
            One text for each component.
        """
        numbers = np.ravel(np.asarray(action))
        return tuple(
            f"{printable(name)} = {number(x, digits)}" for name, x in zip(self.names, numbers, strict=True)
        )


ActionSpec: TypeAlias = DiscreteActions | MultiDiscreteActions | BoxActions
