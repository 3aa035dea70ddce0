"""What came of a proof, and the observation that shows it where it failed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np

from ..base import BaseTree
from ..boxes import Boxes
from ..floats import number, printable

if TYPE_CHECKING:
    from jaxtyping import Float32


@final
@dataclass(frozen=True, eq=False)
class Example:
    """An observation and what is done about it."""

    observation: Float32[np.ndarray, " features"]
    where: str
    """The observation in words, feature by feature."""
    action: str
    """The action in words; where two trees disagree, both."""


@final
@dataclass(frozen=True, eq=False)
class Verdict:
    """Whether something holds for every observation.

    Args:
        name: Of the property.
        rule: What was to be proven.
        holds: Whether it is true of every observation.
        vacuous: Whether it holds only because no observation meets the condition.
        n_leaves: How many leaves the condition concerns.
        n_violating: In how many of these it fails somewhere.
        examples: A counterexample where it fails: one observation, or two where it is about two.
    """

    name: str
    rule: str
    holds: bool
    vacuous: bool = False
    n_leaves: int = 0
    n_violating: int = 0
    examples: tuple[Example, ...] = ()

    @property
    def counterexample(self) -> Float32[np.ndarray, " features"] | None:
        """An observation in which it fails, None where it holds."""
        return self.examples[0].observation if self.examples else None

    @property
    def words(self) -> str:
        """What came of it, in a sentence."""
        if self.vacuous:
            return "holds vacuously: no observation meets the condition"
        if self.holds:
            return f"holds: proven for {_leaves(self.n_leaves)}"
        found = "; then ".join(f"{example.where}: {example.action}" for example in self.examples)
        return f"fails in {self.n_violating} of {_leaves(self.n_leaves)}: {found}"

    def __str__(self) -> str:
        """The name, and what came of it."""
        return f"{printable(self.name)}: {self.words}"


def example(tree: BaseTree, observation: Float32[np.ndarray, " features"]) -> Example:
    """Put an observation, and what a tree does about it, in words."""
    return Example(observation, observation_words(tree, observation), action_words(tree, observation))


def action_words(tree: BaseTree, observation: Float32[np.ndarray, " features"]) -> str:
    """Say what a tree does."""
    return ", ".join(tree.actions.words(tree.predict(observation)))


def observation_words(tree: BaseTree, observation: Float32[np.ndarray, " features"]) -> str:
    """Say what is observed: ``pole angle = 0.2, front is lava``."""
    phrases = []
    for feature, x in enumerate(observation):
        group = tree.group_of.get(feature)
        if group is None:
            phrases.append(f"{printable(tree.feature_names[feature])} = {number(x)}")
        elif x == 1:
            phrases.append(group.words(feature))
    return ", ".join(phrases)


def simplest(boxes: Boxes) -> int:
    """Return which box holds the observation that is easiest to read.

    The one with the fewest numbers other than 0, and of these the one nearest to 0 (by the sum of the distances
    of its features).
    """
    distance = np.maximum(np.maximum(boxes.low, -boxes.high), 0).astype(np.float64)
    # of each group one is 1 in any case
    distance[:, [feature for group in boxes.groups for feature in group.features]] = 0
    return int(np.lexsort((distance.sum(axis=1), np.count_nonzero(distance, axis=1)))[0])


def _leaves(n: int) -> str:
    return "1 leaf" if n == 1 else f"{n} leaves"
