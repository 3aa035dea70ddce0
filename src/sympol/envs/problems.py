"""Faults of an environment in plain words, by what random play has shown and by Gymnasium's checker."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

from .inspection import LONGEST, Inspection
from .spec import EnvSpec

APART = 1e6
"""Features whose sizes differ by more than this factor are named."""
SLOW = 1_000
"""Fewer steps a second than this are called slow."""
_SHOWN = 3
"""The number of features that a problem names."""

_COLOURS = re.compile(r"\x1b\[[0-9;]*m|^\s*(WARN|ERROR): ")
_HARMLESS = re.compile(
    "render|unwrapped version|symmetric and normalized|is deprecated|is now ignored|space (min|max)imum value"
    "|although similar|is not within the observation space|non-deterministic|not equivalent|Casting input"
    "|infos returned|expecting a numpy array|expecting numpy array dtype|support for the `seed` function"
)
"""What Gymnasium's checker says and sympol does not mind, or measures itself."""
_REUSED = (
    "step returns the array that it returned before, with other numbers in it; sympol copies it, other programs that "
    "keep observations may not: return a new array"
)
_PLAIN = {
    "share an object": _REUSED,
    r"`terminated` signal to be a boolean": "step returns a terminated that is neither True nor False",
    r"`truncated` signal to be a boolean": "step returns a truncated that is neither True nor False",
    r"reward returned by `step\(\)` must be": "step returns a reward that is not a plain number; float(reward) is one",
    r"np_random|generated given a seed": "reset does not call super().reset(seed=seed), so that seeds do not reach "
    "self.np_random",
    r"default seed argument": "reset must have seed=None: otherwise all episodes without a seed are the same",
    r"`reset` method does not provide|cannot be reset with": "reset must take a seed and options: def reset(self, *, "
    "seed=None, options=None)",
    r"`info` returned|was not a dictionary": "the info of reset and step must be a dictionary",
    r"truncates after 1 step": "an episode is truncated after its first step",
}
"""What Gymnasium's checker says, as a pattern, and what that means."""


class Problem(NamedTuple):
    """One thing that is wrong, or that will cost.

    Attributes:
        kind: ``"wrong"``, what gives a useless or irreproducible training; ``"note"``, what is worth knowing.
        text: What it is, and the remedy, in one line.
    """

    kind: str
    text: str


def problems(inspection: Inspection) -> list[Problem]:
    """Judge an environment by what was measured.

    Args:
        inspection: The measurements.

    Returns:
        The problems, those that are wrong first.
    """
    found = [*_of_rewards(inspection), *_of_episodes(inspection), *_of_features(inspection)]
    found += [*_of_actions(inspection.spec), *_of_reproduction(inspection), *_of_speed(inspection)]
    found += [*_of_names(inspection.spec), *_checked_by_gymnasium(inspection.spec)]
    return sorted(dict.fromkeys(found), key=lambda problem: problem.kind != "wrong")


def _checked_by_gymnasium(spec: EnvSpec) -> list[Problem]:
    """Return what Gymnasium's own checker says, in plain words.

    An object is not to be disturbed, and what is written in JAX is no environment of Gymnasium's.
    """
    if spec.env is not None or spec.has_one_copy:
        return []
    env = spec.make_host()
    said: list[str] = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                check_env(env.unwrapped, skip_render_check=True, skip_close_check=True)
            except (AssertionError, TypeError, ValueError, gymnasium.error.Error) as error:
                said.append(str(error))
        said += [str(warning.message) for warning in caught]
    finally:
        env.close()
    texts = dict.fromkeys(_in_plain_words(text) for text in said)
    return [Problem("note", text) for text in texts if text]


def _in_plain_words(said: str) -> str:
    text = " ".join(_COLOURS.sub("", _COLOURS.sub("", said)).split())
    plain = next((words for pattern, words in _PLAIN.items() if re.search(pattern, text)), None)
    if plain is None and (not text or _HARMLESS.search(text)):
        return ""
    return plain or f"Gymnasium's checker says: {text[:300]}"


def _of_rewards(seen: Inspection) -> Iterator[Problem]:
    if seen.reward_low == seen.reward_high:
        where = f"{seen.steps:,} random steps"
        if seen.reward_low == 0:
            yield Problem(
                "note",
                f"the reward was 0 in all of {where}: learning begins only where a reward is met by chance; if "
                "that is rare, "
                "reward the way there, too, or start from a tree (--start)",
            )
        else:
            yield Problem(
                "note",
                f"the reward was {seen.reward_low:g} in all of {where}: it says nothing about the actions, "
                "unless by how "
                "long an episode lasts",
            )
    returns = np.array(seen.episodes.returns)
    if len(returns) > 1 and seen.reward_low != seen.reward_high and np.ptp(returns) == 0:
        yield Problem("note", f"every episode had the return {returns[0]:g}, whatever the actions were")


def _of_episodes(seen: Inspection) -> Iterator[Problem]:
    ended, limit = seen.episodes, seen.spec.max_episode_steps
    if not ended.lengths and limit is None:
        yield Problem(
            "wrong",
            f"no episode ended within {min(seen.steps, LONGEST):,} steps and there is no time limit: the policy "
            "would be "
            "judged by episodes that are cut anywhere; give a limit (max_episode_steps, or max_steps of "
            "from_functions)",
        )
    elif not ended.lengths:
        yield Problem("note", f"no episode ended within the {seen.steps:,} steps that were played")
    elif ended.lengths and max(ended.lengths) == 1:
        yield Problem("note", "every episode ended after its first step")
    firsts = seen.first_observations
    if len(firsts) > 1 and (firsts == firsts[0]).all() and not seen.difference:
        yield Problem(
            "note",
            f"all {len(firsts)} episodes begin with the same observation, whatever their seed: the tree is good from "
            "there, and may know no other start; draw the start from self.np_random",
        )


def _of_features(seen: Inspection) -> Iterator[Problem]:
    features = seen.spec.features
    outside = np.flatnonzero(seen.outside)
    if len(outside):
        words = [
            f"{features.names[i]} was {seen.low[i]:g} to {seen.high[i]:g}, declared {features.low[i]:g} to "
            f"{features.high[i]:g}"
            for i in outside[:_SHOWN]
        ]
        yield Problem(
            "wrong",
            f"observations leave their space: {'; '.join(words)}{_more(len(outside))}; bounds that do not hold make "
            "proofs and pruning wrong, so declare wider ones, or None",
        )
    constant = [i for i in np.flatnonzero(seen.low == seen.high) if not _is_rare(seen, int(i))]
    if constant and seen.steps > 1:
        named = ", ".join(f"{features.names[i]} = {seen.low[i]:g}" for i in constant[:_SHOWN])
        yield Problem("note", f"never changed in random play: {named}{_more(len(constant))}")
    changing = np.flatnonzero(seen.low != seen.high)
    sizes = seen.sizes[changing]
    if len(changing) > 1 and sizes.max() > APART * sizes.min():
        small, large = changing[sizes.argmin()], changing[sizes.argmax()]
        yield Problem(
            "note",
            f"features differ in size by a factor of {sizes.max() / sizes.min():.0e}: {features.names[small]} "
            "is at most "
            f"{sizes.min():.2g}, {features.names[large]} up to {sizes.max():.2g}; each is scaled by its own "
            "spread, but the "
            "rules are easier to read in units of similar size",
        )


def _is_rare(seen: Inspection, feature: int) -> bool:
    """Return whether a feature is a category, many of which random play need not meet."""
    return any(feature in group.features for group in seen.spec.features.groups)


def _of_names(spec: EnvSpec) -> Iterator[Problem]:
    given = {
        "feature_names": (spec.features.names, re.compile(r"x(\[[\d, ]+\])?")),
        "action_names": (spec.actions.names, re.compile(r"action( \d+|\[\d+\])?")),
    }
    missing = {
        attribute: names[0]
        for attribute, (names, default) in given.items()
        if all(map(default.fullmatch, names))
    }
    if missing:
        yield Problem(
            "note",
            f"a tree will speak of {' and '.join(missing.values())}: give the environment {' and '.join(missing)}, a "
            "sequence of texts each, for rules that say what they mean",
        )


def _of_actions(spec: EnvSpec) -> Iterator[Problem]:
    low, high = getattr(spec.actions, "low", None), getattr(spec.actions, "high", None)
    if low is None or high is None:
        return
    unbounded = [
        name
        for name, least, most in zip(spec.actions.names, low, high, strict=True)
        if not np.isfinite([least, most]).all()
    ]
    if unbounded:
        yield Problem(
            "wrong",
            f"actions have no bounds: {', '.join(unbounded[:_SHOWN])}{_more(len(unbounded))}; exploration "
            "begins around "
            "0 with a spread of 1, whatever their unit is; give the action space the bounds of what it controls",
        )


def _of_reproduction(seen: Inspection) -> Iterator[Problem]:
    if seen.difference:
        yield Problem(
            "wrong",
            f"the same seed and the same actions gave two episodes: {seen.difference}; draw all random "
            "numbers from "
            "self.np_random, which super().reset(seed=seed) seeds, and let reset set everything that step changes",
        )
    if seen.is_reused:
        yield Problem("note", _REUSED)


def _of_speed(seen: Inspection) -> Iterator[Problem]:
    rate = seen.steps_per_second
    if seen.spec.backend == "host" and rate < SLOW:
        yield Problem(
            "note",
            f"{rate:,.0f} steps a second is slow: a training of a million steps spends {1e6 / rate / 3600:.1f} "
            "h of one core "
            "in the environment",
        )
    if seen.reset_seconds > 20 * seen.step_seconds and seen.reset_seconds > 1e-3:
        yield Problem(
            "note",
            f"a reset takes {1e3 * seen.reset_seconds:,.3g} ms, as long as "
            f"{seen.reset_seconds / seen.step_seconds:,.0f} "
            "steps: make once what does not change from episode to episode",
        )
    if (
        seen.steps > 100
        and seen.longest_step_seconds > 100 * seen.step_seconds
        and seen.longest_step_seconds > 0.1
    ):
        yield Problem(
            "note",
            f"one step took {seen.longest_step_seconds:.2g} s, where most take {1e3 * seen.step_seconds:.2g} ms",
        )


def _more(count: int) -> str:
    return f" and {count - _SHOWN} more" if count > _SHOWN else ""
