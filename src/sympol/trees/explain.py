"""Explanations of single decisions: why a tree acts as it does, and what would change its action.

Three answers, each exact: the path through the tree, as one sentence; the smallest part of the observation that
forces the action (`sympol.trees.sufficient_reason`); and for every other action the nearest observation that gets it
(`sympol.trees.counterfactual`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from .base import BaseTree
from .counterfactual import Counterfactual, Norm, counterfactuals
from .explanation_features import local_neighborhood
from .sufficient_reason import Reason, smallest_reason
from .text import leaf_conditions, leaf_words

if TYPE_CHECKING:
    from jaxtyping import Float32
    from numpy.typing import ArrayLike


@final
@dataclass(frozen=True, eq=False)
class Explanation:
    """The explanation of one decision: its path, its smallest reason, and its counterfactuals."""

    observation: Float32[np.ndarray, " features"]
    """The observation as the tree sees it: float32, subnormal numbers zero."""
    action: np.ndarray
    """As `DecisionTree.predict` returns it."""
    answer: str
    """The action in words."""
    leaf: int
    """The number of the leaf that is reached."""
    sentence: str
    """The path through the tree: ``push left, because pole angle ≤ 0.1 and front is lava.``"""
    reason: Reason
    """The smallest sufficient reason."""
    counterfactuals: tuple[Counterfactual, ...]
    """One for every other action, the nearest first."""

    @property
    def reason_sentence(self) -> str:
        """The reason, as a sentence."""
        if not self.reason.units:
            return f"Nothing is needed for {self.answer}: no observation gets another action."
        return (
            f"{self.reason.words} {'alone forces' if len(self.reason.units) == 1 else 'together force'} it."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain JSON; infinite distances become null.

        Returns:
            A dictionary that `json.dumps` accepts; infinite distances are None.
        """
        return {
            "observation": self.observation.tolist(),
            "action": np.asarray(self.action).tolist(),
            "answer": self.answer,
            "leaf": self.leaf,
            "sentence": self.sentence,
            "reason": {"features": list(self.reason.names), "words": self.reason.words},
            "counterfactuals": [
                {
                    "action": np.asarray(one.action).tolist(),
                    "answer": one.answer,
                    "observation": None if one.observation is None else one.observation.tolist(),
                    "distance": None if one.observation is None else one.distance,
                    "changes": list(one.changes),
                }
                for one in self.counterfactuals
            ],
        }

    def __str__(self) -> str:
        """Return everything for people, one line for each sentence."""
        other = [f"{one.words}." for one in self.counterfactuals]
        return "\n".join([self.sentence, self.reason_sentence, *other])


def explain(
    tree: BaseTree,
    observation: ArrayLike,
    *,
    immutable: Iterable[str | int] = (),
    norm: Norm = "l1",
    scale: Mapping[str | int, float] | None = None,
) -> Explanation:
    """Explain one decision.

    Args:
        tree: The policy.
        observation: One observation, [features]; finite.
        immutable: Features and groups that no counterfactual may change, by name or position.
        norm: The distance between observations: ``"l1"``, ``"l0"`` or ``"linf"``.
        scale: What counts as a change by 1, for features and groups, by name or position; 1 where it is not given.

    Returns:
        The path, the smallest sufficient reason, and the counterfactuals.

    Raises:
        ValueError: If the observation does not fit the tree or is not finite, a feature does not exist, a scale is
            not positive, or the norm is another one.
        TypeError: If the observation does not hold numbers.
    """
    here = local_neighborhood(tree, observation)
    here.x.setflags(write=False)
    known = next(known for leaf, known in leaf_conditions(tree) if leaf == here.leaf)
    answer = ", ".join(leaf_words(tree, here.leaf))
    way = " and ".join(condition.words() for condition in known.values())
    return Explanation(
        observation=here.x,
        action=tree.leaf_actions[here.leaf],
        answer=answer,
        leaf=here.leaf,
        sentence=f"{answer}, because {way}." if way else f"{answer}, always.",
        reason=smallest_reason(tree, here),
        counterfactuals=counterfactuals(tree, here, immutable=immutable, norm=norm, scale=scale),
    )
