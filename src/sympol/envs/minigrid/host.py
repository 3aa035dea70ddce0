"""Farama's MiniGrid with the observations and actions of a `View`, and our randomised DistShift.

The only module that imports `minigrid`, and with it pygame: it is itself imported when an environment is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, SupportsFloat

import gymnasium
import minigrid
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from jaxtyping import Float32
from minigrid.envs.distshift import DistShiftEnv

from .cells import OBJECTS
from .distshift import Layout, random_layouts
from .view import View

assert minigrid.__version__  # importing it is what registers its environments


class FlatView(gymnasium.Wrapper, RecordConstructorArgs):
    """A wrapper with flat named features as observations, and only some of the actions; see `View`.

    Args:
        env: An environment of Farama's.
        view: The view.

    Raises:
        ValueError: The environment lacks one of the view's actions; some have fewer than seven.
    """

    def __init__(self, env: gymnasium.Env, view: View):
        num_actions = int(getattr(env.action_space, "n", 0))
        if max(view.actions) >= num_actions:
            raise ValueError(
                f"actions must be from 0 to {num_actions - 1}, which are all that {env} has, got {view.actions}"
            )
        RecordConstructorArgs.__init__(self, view=view)
        gymnasium.Wrapper.__init__(self, env)
        self.view = view
        self.observation_space = gymnasium.spaces.Box(view.low, view.high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Discrete(len(view.actions))
        self.feature_names, self.action_names, self.groups = (
            view.feature_names,
            view.action_names,
            view.groups,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32[np.ndarray, " features"], dict[str, Any]]:
        """Start an episode. See `gymnasium.Env.reset`."""
        observation, info = self.env.reset(seed=seed, options=options)
        return self.view.encode(observation["image"]), info

    def step(
        self, action: Any
    ) -> tuple[Float32[np.ndarray, " features"], SupportsFloat, bool, bool, dict[str, Any]]:
        """Take one of the view's actions.

        Args:
            action: Its position in the view.

        Returns:
            As in Gymnasium.

        Raises:
            ValueError: There is no such action.
        """
        if not 0 <= action < len(self.view.actions):
            raise ValueError(
                f"action must be from 0 to {len(self.view.actions) - 1} ({', '.join(self.action_names)}), "
                f"got {action!r}"
            )
        observation, reward, terminated, truncated, info = self.env.step(self.view.actions[action])
        return self.view.encode(observation["image"]), reward, terminated, truncated, info


class DistShiftRandom(DistShiftEnv):
    """DistShift1 with its second strip in row 2 or 5 and its goal on any empty cell, drawn at every reset.

    ``reset(options={"strip2_row": 5, "goal": (7, 5)})`` pins either or both (x from the left, y from the top); see
    `sympol.envs.minigrid.random_layouts`.
    """

    def __init__(self, **kwargs: Any):
        self._pinned: Mapping[str, Any] = {}
        super().__init__(strip2_row=2, **kwargs)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode.

        Args:
            seed: As in Gymnasium.
            options: ``strip2_row`` or ``goal`` of the layout, or both.

        Returns:
            As in Gymnasium.

        Raises:
            ValueError: No layout has these options.
        """
        self._pinned = options or {}
        _matching(self._pinned)
        return super().reset(seed=seed, options=options)

    def _gen_grid(self, width: int, height: int) -> None:
        self.strip2_row, self.goal_pos = self._rand_elem(_matching(self._pinned))
        super()._gen_grid(width, height)


def _matching(pinned: Mapping[str, Any]) -> list[Layout]:
    goal = tuple(pinned["goal"]) if "goal" in pinned else None
    found = [
        layout
        for layout in random_layouts()
        if pinned.get("strip2_row", layout[0]) == layout[0] and goal in (None, layout[1])
    ]
    if not found or not pinned.keys() <= {"strip2_row", "goal"}:
        raise ValueError(
            "options must be strip2_row (2 or 5), goal (x, y of a cell without wall or lava, other than the "
            f"agent's (1, 1)), or both, got {dict(pinned)}; sympol.envs.minigrid.random_layouts() lists them all"
        )
    return found


def rows_of(env: gymnasium.Env) -> list[list[str]]:
    """Return what is in every cell of a MiniGrid now, without the agent.

    Args:
        env: The environment.

    Returns:
        Names of objects, row by row from the top.
    """
    world: Any = env.unwrapped
    objects = world.grid.encode()[:, :, 0].T
    return [[OBJECTS[int(number)] for number in row] for row in objects]


def make(env_id: str, view: View, *, all_actions: bool = False, **kwargs: Any) -> gymnasium.Env:
    """Make one of Gymnasium's environments whose observation is MiniGrid's, seen through a view.

    Args:
        env_id: The id in Gymnasium.
        view: The view.
        all_actions: Whether to take all actions of the environment instead of the view's.
        kwargs: Arguments of the environment.

    Returns:
        The environment.
    """
    # the checker would repeat its warnings for every copy
    env = gymnasium.make(env_id, disable_env_checker=True, agent_view_size=view.view_size, **kwargs)
    if all_actions:
        view = replace(view, actions=tuple(range(int(getattr(env.action_space, "n", 0)))))
    return FlatView(env, view)
