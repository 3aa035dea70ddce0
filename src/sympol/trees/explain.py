"""Why a tree acts as it does in one observation, and what would have to be different for it to act otherwise.

Three answers, each exact: the way through the tree, as one sentence; the smallest part of the observation that
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
from .explanation_features import around
from .sufficient_reason import Reason, smallest_reason
from .text import leaf_conditions, leaf_words

if TYPE_CHECKING:
    from jaxtyping import Float32
    from numpy.typing import ArrayLike


@final
@dataclass(frozen=True, eq=False)
class Explanation:
    """Why, and what else."""

    observation: Float32[np.ndarray, " features"]
    """As the tree sees it: float32, subnormal numbers zero."""
    action: np.ndarray
    answer: str
    """The action in words."""
    leaf: int
    sentence: str
    """The way through the tree: ``push left, because pole angle ≤ 0.1 and front is lava.``"""
    reason: Reason
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
        """All of it as plain JSON; infinite distances are null."""
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
        """All of it for people, a line each."""
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
        observation: What it saw, [features]; finite.
        immutable: Features and groups that no counterfactual may change, by name or position.
        norm: How far observations are apart: ``"l1"``, ``"l0"`` or ``"linf"``.
        scale: What counts as a change by 1, for features and groups, by name or position; 1 where it is not given.

    Raises:
        ValueError: an observation that is not one of the tree's, or not finite; a feature that there is not, a scale
            that is not positive, another norm.
        TypeError: an observation that holds no numbers.
    """
    here = around(tree, observation)
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
