"""Episodes as the page plays them: what was observed, done and earned at each step, and what it looked like."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import gymnasium
import numpy as np

from ..agents import Agent
from ..envs.copies import open_copies
from ..envs.spec import EnvSpec
from ..film.rendering import CannotRender, frame_of, rendering, steps
from ..play import PURPOSE_TAGS, acting
from ..trees import DecisionTree
from ..trees.report import packed
from .frames import Frames, within_budget

MOST_NUMBERS = 100_000
"""Of all observations in a page: longer episodes are cut."""
_FPS, _SLOWEST_FPS, _SECONDS = 30.0, 2.0, 8.0
_DIGITS = 3


def drawing_of(spec: EnvSpec) -> str | None:
    """Return the drawing that the page makes of observations (drawings.js), None where it needs frames."""
    return spec.drawing if spec.drawing and spec.preset_id else None


def filmed(
    policies: Sequence[Agent | DecisionTree],
    spec: EnvSpec,
    seeds: Sequence[int],
    tell: Callable[[str], None],
) -> tuple[list[list[dict[str, Any]]], float]:
    """Play an episode a seed with each policy; return them, policy by policy, and the steps to show in a second.

    Episodes are cut where all observations together would be more than `MOST_NUMBERS`. Frames are kept where the
    page cannot draw the environment and it draws itself; all of them together are small enough for a page.
    """
    most_steps = max(1, MOST_NUMBERS // (len(spec.features.names) * len(policies) * len(seeds)))
    films: list[Frames] = []
    with _shown(spec) as (env, draws):
        all_played = []
        for policy in policies:
            answers = acting(policy, spec, True, np.random.default_rng([0, PURPOSE_TAGS["test"]]))
            played = []
            for seed in seeds:
                tell(f"playing episode {len(played) + 1} of {len(seeds)}")
                frames = Frames() if draws else None
                episode = _played(lambda x, act=answers: act(x[None])[0], spec, env, seed, most_steps, frames)
                films += [] if frames is None else [frames]
                played.append((episode, frames))
            all_played.append(played)
        own_fps = float(env.metadata.get("render_fps") or _FPS)
    within_budget(films)
    episodes = [
        [episode | {"frames": None if frames is None else frames.data()} for episode, frames in played]
        for played in all_played
    ]
    longest = max(episode["length"] for played in episodes for episode in played)
    return episodes, min(own_fps, _FPS, max(_SLOWEST_FPS, longest / _SECONDS))


@contextlib.contextmanager
def _shown(spec: EnvSpec) -> Iterator[tuple[gymnasium.Env, bool]]:
    """Make the environment, and say whether its frames are to be kept."""
    if drawing_of(spec) is None:
        with contextlib.ExitStack() as stack:
            try:
                env = stack.enter_context(rendering(spec))
            except CannotRender:
                env = None
            if env is not None:
                yield env, True
                return
    with open_copies(spec, 1) as (env,):
        yield env, False


def _played(
    act: Callable[[np.ndarray], Any],
    spec: EnvSpec,
    env: gymnasium.Env,
    seed: int,
    most_steps: int,
    frames: Frames | None,
) -> dict[str, Any]:
    """Play one episode; its last observation is the one on which nothing was done any more."""
    observed, said, earned, end = [], [], [], ""
    for now in steps(
        lambda observation: act(spec.features.flatten(observation)), spec, env, seed, most_steps
    ):
        observed.append(spec.features.flatten(now.observation))
        earned.append(round(now.earned, 6))
        end = now.end
        if not end:
            said.append(", ".join(spec.actions.words(now.action, digits=_DIGITS)))
        if frames is not None and (end or frames.wants(now.step)):
            frames.add(now.step, frame_of(env, spec))
    words = list(dict.fromkeys(said))
    return {
        "seed": seed,
        "length": len(said),
        "end": end,
        "observations": packed(np.stack(observed)),
        "earned": earned,
        "said": words,
        "says": [words.index(one) for one in said],
    }
