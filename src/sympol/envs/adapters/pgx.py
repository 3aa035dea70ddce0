"""Games of pgx for a single player."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary
from jax import Array

from ..foreign import Answer, ForeignEnv, Library

_ALWAYS_LEGAL = "minatar-"
"""How the ids of games begin in which every action is legal at all times."""


class Pgx(Library):
    """The games of pgx by the ids of `pgx.make`."""

    prefix = package = "pgx"

    def names(self) -> Iterable[str]:
        """See `Library.names`."""
        return self.library().available_envs()

    def make(self, name: str, *, max_episode_steps: int | None = None, **kwargs: Any) -> ForeignEnv:
        """See `Library.make`."""
        return PgxEnv(self.library().make(name, **kwargs), max_episode_steps)

    def wrap(self, env: Any) -> ForeignEnv:
        """See `Library.wrap`."""
        wrapped = PgxEnv(env, None)
        wrapped.recipe = {} if env.id in self.names() else None  # a game has no other settings
        return wrapped


class PgxEnv(ForeignEnv):
    """A game of pgx. Where some actions are illegal, the mask of the legal ones is observed.

    An illegal action ends the game with a reward of −1.
    """

    def __init__(self, env: Any, max_episode_steps: int | None) -> None:
        if env.num_players != 1:
            raise ValueError(
                f"pgx:{env.id} is a game of {env.num_players} players, and sympol trains one; choose one of the games "
                "for a single player, such as pgx:minatar-breakout or pgx:2048"
            )
        self.env = env
        self.is_masked = not env.id.startswith(_ALWAYS_LEGAL)
        state = jax.eval_shape(env.init, jax.ShapeDtypeStruct((2,), np.uint32))
        seen = state.observation
        board: Any = (
            MultiBinary(seen.shape) if seen.dtype == bool else Box(-np.inf, np.inf, seen.shape, np.float32)
        )
        mask = MultiBinary(state.legal_action_mask.shape)
        super().__init__(
            f"pgx:{env.id}",
            Dict({"board": board, "legal": mask}) if self.is_masked else board,
            Discrete(state.legal_action_mask.shape[0]),
            max_episode_steps,
        )

    def begin(self, key: Array) -> tuple[Any, Any]:
        """See `ForeignEnv.begin`."""
        state = self.env.init(key)
        return state, self._observed(state)

    def advance(self, key: Array, state: Any, action: Array) -> Answer:
        """See `ForeignEnv.advance`."""
        after = self.env.step(state, action, key)
        return Answer(after, self._observed(after), after.rewards[0], after.terminated, after.truncated)

    def _observed(self, state: Any) -> Any:
        if not self.is_masked:
            return state.observation
        return {"board": state.observation, "legal": state.legal_action_mask}
