"""The policy that a training has reached: its actor, its outputs, and its tree."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from .algorithms.config import Config
from .algorithms.inference import outputs
from .algorithms.normalization import unbroken_bounds
from .algorithms.state import TrainState
from .algorithms.warm_start import Start
from .envs.spec import EnvSpec
from .policies.action_units import multiply_outputs, units_and_centers
from .policies.actor import Actor
from .policies.extract import extract_tree
from .policies.tree import Tree
from .search.size_limit import extract_unmasked, has_limit, tree_within_limit
from .trees import DecisionTree
from .trees.actions import ActionSpec, BoxActions


class TrainedPolicy:
    """The best policy that was validated or, without ``select_best``, the last one.

    Args:
        spec: The environment.
        config: The configuration of the training.
        seed: The seed of the training; pruning by return draws its episodes from it.
        state: The state of the training; None before its first steps.
        start: The tree that the training starts from, if any, which is the policy before the first steps.
    """

    def __init__(
        self, spec: EnvSpec, config: Config, seed: int, state: TrainState | None, start: Start | None = None
    ) -> None:
        self.spec, self.config, self.seed = spec, config, seed
        self._state, self._start = state, start

    def is_of(self, state: TrainState | None) -> bool:
        """Return whether this is the policy of a state of the training.

        Args:
            state: The state; None before the first steps.

        Returns:
            True if it is the very same object.
        """
        return self._state is state

    @property
    def is_tree(self) -> bool:
        """True where the policy is a tree; with method "auto" it is a teacher at first."""
        if self._state is None:
            return self.config.policy == "tree"
        return isinstance(self._state.networks.actor, Tree)

    @property
    def state(self) -> TrainState:
        """The state of the training.

        Raises:
            RuntimeError: Nothing has been trained.
        """
        if self._state is None:
            raise RuntimeError("there is no policy yet: call learn() first")
        return self._state

    @cached_property
    def actor(self) -> Actor:
        """The actor, its outputs in the units of the environment."""
        state = self.state
        actor = state.validation.best_actor if self.config.select_best else state.networks.actor
        units, _ = units_and_centers(self.spec.action_space, scaled=self.config.scale_actions)
        return multiply_outputs(actor, units)

    @property
    def actions(self) -> ActionSpec:
        """The meaning of the outputs, with the standard deviation of continuous actions."""
        if self._state is None and self._start is not None:
            return self._start.tree.actions
        actions = self.spec.actions
        if not isinstance(actions, BoxActions):
            return actions
        return replace(actions, std=tuple(np.exp(np.asarray(self.actor.log_std)).tolist()))

    def metadata(self) -> dict[str, Any]:
        """Return the fields of a `DecisionTree` made of this policy that describe its features and actions.

        Returns:
            Keyword arguments of `DecisionTree`: actions, names and bounds of the features, groups.
        """
        low, high = unbroken_bounds(self.spec.features, self.state)
        names = self.spec.features.metadata()
        return {"actions": self.actions, **names, "feature_low": low, "feature_high": high}

    def outputs(self, x: Float32[ndarray, "batch features"]) -> Float32[ndarray, "batch outputs"]:
        """Compute logits, or means of continuous actions.

        Args:
            x: Observations ``[batch, features]``.

        Returns:
            The outputs ``[batch, outputs]``.
        """
        if self.is_tree:
            return self.full_tree.outputs(x)
        return outputs(self.actor, self.state.normalizer, x)

    @cached_property
    def extracted_tree(self) -> DecisionTree:
        """The actor as a tree, without the nodes that a size limit has masked; or the tree to start from."""
        if self._state is None and self._start is not None:
            return self._start.tree
        actor = self.actor
        if not isinstance(actor, Tree):
            if self.config.policy == "tree":
                raise RuntimeError(
                    f"there is no tree yet after {int(self.state.timestep)} steps: with method auto a teacher is "
                    "trained first; see Agent.has_tree"
                )
            raise RuntimeError(
                f"{self.config.policy} is no tree; make one of it with `sympol distill` or sympol.distill_policy"
            )
        shift, scale = (np.asarray(part) for part in self.state.normalizer)
        extract = extract_unmasked if has_limit(self.config) or self.config.grow_splits else extract_tree
        return extract(actor, shift, scale, **self.metadata())

    @cached_property
    def full_tree(self) -> DecisionTree:
        """`extracted_tree`, or less of it where the size limit is still to be imposed."""
        timestep = 0 if self._state is None else int(self._state.timestep)
        return tree_within_limit(self.extracted_tree, timestep, self.spec, self.config, self.seed)

    @cached_property
    def pruned_tree(self) -> DecisionTree:
        """`full_tree` without splits that change no action."""
        return self.full_tree.prune(observations=self.spec.all_observations())
