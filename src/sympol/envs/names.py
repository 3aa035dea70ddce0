"""Names of the features and actions of Gymnasium's own environments.

Those written in JAX carry their names themselves; `sympol.register` adds and replaces names.
"""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import gymnasium
from gymnasium.spaces import flatdim


class Names(NamedTuple):
    """The names of the features and actions of one environment, with units where there are any.

    Attributes:
        features: Names of the features.
        actions: Names of the actions, or of the components of an action.
        integers: Positions of features that are whole numbers, though the space does not say so.
    """

    features: tuple[str, ...]
    actions: tuple[str, ...]
    integers: tuple[int, ...] = ()


_LANDER = (
    "horizontal position",
    "height",
    "horizontal speed",
    "vertical speed",
    "angle (rad)",
    "angular speed",
    "left leg touches",
    "right leg touches",
)
_LEGS = tuple(
    f"{what} {leg}"
    for leg in (1, 2)
    for what in ("hip angle", "hip speed", "knee angle", "knee speed", "ground contact of leg")
)
_MOVES = ("left", "down", "right", "up")
_STOPS = ("red", "green", "yellow", "blue")


def _cells(rows: int, columns: int) -> tuple[str, ...]:
    return tuple(f"at row {row}, column {column}" for row, column in product(range(rows), range(columns)))


NAMES: dict[str, Names] = {
    "LunarLander-v3": Names(
        _LANDER, ("do nothing", "fire left engine", "fire main engine", "fire right engine"), integers=(6, 7)
    ),
    "LunarLanderContinuous-v3": Names(_LANDER, ("main engine", "side engines"), integers=(6, 7)),
    "BipedalWalker-v3": Names(
        (
            "hull angle (rad)",
            "hull angular speed",
            "horizontal speed",
            "vertical speed",
            *_LEGS,
            *(f"lidar {ray}" for ray in range(10)),
        ),
        ("torque of hip 1", "torque of knee 1", "torque of hip 2", "torque of knee 2"),
        integers=(8, 13),
    ),
    "FrozenLake-v1": Names(_cells(4, 4), _MOVES),
    "FrozenLake8x8-v1": Names(_cells(8, 8), _MOVES),
    "CliffWalking-v1": Names(_cells(4, 12), ("up", "right", "down", "left")),
    "Taxi-v4": Names(
        tuple(
            f"taxi {cell}, passenger {passenger}, to {destination}"
            for cell, passenger, destination in product(
                _cells(5, 5), (*(f"at {stop}" for stop in _STOPS), "in the taxi"), _STOPS
            )
        ),
        ("down", "up", "right", "left", "pick up", "drop off"),
    ),
    "Blackjack-v1": Names(
        (
            *(f"hand of {total}" for total in range(32)),
            *(f"dealer shows {card}" for card in ("nothing", "an ace", *range(2, 11))),
            "no usable ace",
            "a usable ace",
        ),
        ("stick", "hit"),
    ),
}


def known_names(env: object, name: str) -> dict[str, tuple[Any, ...]]:
    """Return the known names of an environment of Gymnasium's.

    Arguments can give the same environment another map or other actions, and a wrapper anything at all, so names that
    do not fit are left out.

    Args:
        env: The environment.
        name: Its id.

    Returns:
        Those of ``feature_names``, ``integers`` and ``action_names`` that are known and fit.
    """
    spec = env.spec if isinstance(env, gymnasium.Env) else None
    if name not in NAMES or spec is None or spec.additional_wrappers or not isinstance(env, gymnasium.Env):
        return {}
    found = {
        "feature_names": (NAMES[name].features, env.observation_space),
        "action_names": (NAMES[name].actions, env.action_space),
    }
    fitting = {what: names for what, (names, space) in found.items() if flatdim(space) == len(names)}
    return {**fitting, "integers": NAMES[name].integers} if "feature_names" in fitting else fitting
