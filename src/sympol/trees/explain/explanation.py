"""Explanations of single decisions: the path through the tree, the reason, and the counterfactuals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..base import BaseTree
from ..text import leaf_conditions, leaf_words
from .counterfactual import Counterfactual, Norm, counterfactuals
from .neighborhood import neighborhood_of
from .sufficient_reason import Reason, smallest_reason

if TYPE_CHECKING:
    from jaxtyping import Float32
    from numpy.typing import ArrayLike


@final
@dataclass(frozen=True, eq=False)
class Explanation:
    """Why a tree takes an action in an observation, and what would make it take another.

    Args:
        observation: The observation, as the tree sees it: float32, subnormal numbers zero.
        action: The action, as `DecisionTree.predict` returns it.
        answer: The action in words.
        leaf: The leaf in which the observation ends.
        sentence: The path through the tree: ``push left, because pole angle ≤ 0.1 and front is lava.``
        reason: The fewest features that force the action.
        counterfactuals: The nearest observation for every other action, the nearest first.
    """

    observation: Float32[np.ndarray, " features"]
    action: np.ndarray
    answer: str
    leaf: int
    sentence: str
    reason: Reason
    counterfactuals: tuple[Counterfactual, ...]

    @property
    def reason_sentence(self) -> str:
        """The reason, as a sentence."""
        if not self.reason.features:
            return f"Nothing is needed for {self.answer}: no observation gets another action."
        return f"{self.reason.words} {'alone forces' if len(self.reason.features) == 1 else 'together force'} it."

    def to_dict(self) -> dict[str, Any]:
        """Return the explanation as plain JSON.

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
        """Return the sentences, one a line."""
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
        observation: The observation [features]; finite.
        immutable: Features and groups that no counterfactual may change, by name or position.
        norm: The measure of distance: ``"l1"``, ``"l0"`` or ``"linf"``.
        scale: The change that counts as 1 for features and groups, by name or position; 1 by default.

    Returns:
        The path, the smallest sufficient reason, and the counterfactuals.

    Raises:
        ValueError: If the observation has another shape or is not finite, a feature does not exist, a scale is not
            positive and finite, or the norm is unknown.
        TypeError: If the observation does not hold numbers.
    """
    near = neighborhood_of(tree, observation)
    near.x.setflags(write=False)
    known = next(known for leaf, known in leaf_conditions(tree) if leaf == near.leaf)
    answer = ", ".join(leaf_words(tree, near.leaf))
    path = " and ".join(condition.words() for condition in known.values())
    return Explanation(
        observation=near.x,
        action=near.actions[near.own],
        answer=answer,
        leaf=near.leaf,
        sentence=f"{answer}, because {path}." if path else f"{answer}, always.",
        reason=smallest_reason(tree, near),
        counterfactuals=counterfactuals(tree, near, immutable=immutable, norm=norm, scale=scale),
    )
