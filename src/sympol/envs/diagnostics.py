"""Warnings about environments: what trains or is measured without an error, but not as its user may think."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import gymnasium
from gymnasium.spaces import Box, Dict, Tuple
from gymnasium.wrappers import NormalizeObservation, NormalizeReward

MANY_FEATURES = 2_000
"""More than these are warned of."""
SHORTEST_SIDE = 16
"""A matrix with no side shorter than this may be a picture."""


class EpisodesCut(UserWarning):
    """An environment did not end its episodes, so they were cut; a return is what was earned until then."""


class OwnStatistics(UserWarning):
    """An environment scales what it returns by statistics of its own, which each copy gathers for itself."""


class ManyFeatures(UserWarning):
    """An environment returns pictures, or so many features that a tree can hardly learn from them or be read."""


class SameEpisodes(UserWarning):
    """All test episodes are one and the same, so that their number and their spread say nothing."""


def warn_of_cut(env_name: str, where: str, limit: int) -> None:
    """Warn that episodes were cut.

    Args:
        env_name: The environment.
        where: The name of what cuts them.
        limit: The number of steps after which they are cut.
    """
    warnings.warn(
        f"{env_name} did not end an episode within {limit:,} steps, so {where} cuts its episodes there and counts what "
        "they earned until then; give the environment a time limit (gymnasium.wrappers.TimeLimit, or "
        "max_episode_steps) to choose another length",
        EpisodesCut,
        stacklevel=1,  # one place, so that Python says it once
    )


def warn_of_same_episodes(env_name: str, number: int) -> None:
    """Warn that test episodes were one and the same.

    Args:
        env_name: The environment.
        number: The number of episodes.
    """
    warnings.warn(
        f"the {number:,} test episodes on {env_name} are all the same, whatever their seed: one of them would say as "
        "much, and a spread of 0 says nothing about other starts. If the environment is meant to vary, it must draw "
        "its random numbers from self.np_random, which super().reset(seed=seed) seeds",
        SameEpisodes,
        stacklevel=1,
    )


def warn_of_environment(env: object, env_name: str, num_features: int) -> None:
    """Warn of wrappers that normalise, and of observations that a tree is no policy for.

    Args:
        env: The environment.
        env_name: Its name.
        num_features: The number of its features.
    """
    wrappers = [
        type(w).__name__ for w in _wrappers(env) if isinstance(w, NormalizeObservation | NormalizeReward)
    ]
    if wrappers:
        warnings.warn(
            f"{env_name} contains {' and '.join(wrappers)}: every copy of it gathers statistics of its own, so that "
            "the same state is observed or rewarded differently in each, and what is reported is no return of the "
            "environment; leave the wrapper out, as sympol scales features itself (normalize_obs) and rewards by "
            "reward_scale",
            OwnStatistics,
            stacklevel=1,
        )
    pictures = [
        space.shape for space in _boxes(getattr(env, "observation_space", None)) if _is_picture(space)
    ]
    if pictures:
        seen = f"what look like pictures, of shape {' and '.join(map(str, pictures))}"
    elif num_features > MANY_FEATURES:
        seen = f"more than {MANY_FEATURES:,} features"
    else:
        return
    warnings.warn(
        f"{env_name} returns {seen}; each of the {num_features:,} numbers is a feature of its own, and a tree that "
        "asks about one at a time needs more splits than can be learnt or read. Let the environment return the few "
        "quantities that matter, for instance through gymnasium.wrappers.TransformObservation",
        ManyFeatures,
        stacklevel=1,
    )


def _wrappers(env: object) -> Iterator[gymnasium.Wrapper]:
    while isinstance(env, gymnasium.Wrapper):
        yield env
        env = env.env


def _boxes(space: object) -> Iterator[Box]:
    if isinstance(space, Box):
        yield space
    elif isinstance(space, Dict | Tuple):
        for part in space.values() if isinstance(space, Dict) else space:
            yield from _boxes(part)


def _is_picture(space: Box) -> bool:
    """Return whether a box is a matrix of some size, or several such matrices."""
    return len(space.shape) in (2, 3) and sorted(space.shape)[-2] >= SHORTEST_SIDE
