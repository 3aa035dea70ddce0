"""Many episodes side by side, and whole episodes played by trees: the part of this package that others call.

Seeds are numbers below 2^64. The power of engines is float64 ``[..., 2]``: that of the main engine, 0 or 0.5 to 1,
and that of a side engine, negative for the left one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, Shaped, UInt64
from numpy import ndarray

from .lander import FEATURES, LIMIT, start, step
from .layout import Landing, allocate_landings, allocate_lanes, borrowed_landings, borrowed_lanes
from .machine import borrowed, compiled

_BY_ACTION = np.array([[0, 0], [0, -1], [1, 0], [0, 1]], np.float64)
"""The power for each action: nothing, the left engine, the main one, the right one."""
MAX_RUNNING = 64
"""Number of episodes that run at a time: enough that there are always some on the ground and some in the air, which are
solved separately."""
EPISODE = np.dtype([("job", "i8"), ("tree", "i8"), ("row", "i8"), ("length", "i8"), ("total", "f8")])
"""The number of an episode, the tree that plays it, and its length and return so far; ``row`` is the row of the
results."""
_UNOBSERVED = np.zeros((0, LIMIT, FEATURES), np.float32)


class StepResult(NamedTuple):
    """The result of a step of some copies; rows of copies that were not stepped are zeros."""

    observation: Float32[ndarray, "copies features"]
    reward: Float64[ndarray, " copies"]
    terminated: Bool[ndarray, " copies"]
    truncated: Bool[ndarray, " copies"]


def engine_power(
    actions: Shaped[ndarray, "*batch"] | Shaped[ndarray, "*batch 2"],
) -> Float64[ndarray, "*batch 2"]:
    """Return the power of the engines that actions set going.

    Args:
        actions: One of the four actions each, or two numbers between -1 and 1.

    Returns:
        The power of the main engine and of a side engine.
    """
    if actions.dtype.kind in "iu":
        return _BY_ACTION[actions]
    wanted = np.clip(actions.astype(np.float64), -1, 1)
    main, side = wanted[..., 0], wanted[..., 1]
    return np.stack(
        [np.where(main > 0, (main + 1) * 0.5, 0.0), np.where(np.abs(side) > 0.5, side, 0.0)], axis=-1
    )


class Copies:
    """Copies of the environment, each at its own point of an episode; one that ends is followed by the next.

    Args:
        seeds: The seed of the first episode of each copy.
    """

    def __init__(self, seeds: UInt64[ndarray, " copies"]) -> None:
        self.number = len(seeds)
        self._landings, self._lanes = allocate_landings(self.number), allocate_lanes()
        self.observation = np.zeros((self.number, FEATURES), np.float32)
        """The observations that the next actions answer to."""
        self.restart(np.arange(self.number), seeds)

    def restart(self, which: Int64[ndarray, " restarted"], seeds: UInt64[ndarray, " copies"]) -> None:
        """Begin new episodes in some copies.

        Args:
            which: The copies.
            seeds: The seed of each copy's episode, of those that go on, too.
        """
        _start(self._landings, which, seeds, self.observation, self._lanes)

    def step(
        self,
        power: Float64[ndarray, "copies 2"],
        wanted: Bool[ndarray, " copies"],
        next_seeds: UInt64[ndarray, " copies"],
    ) -> StepResult:
        """Take one step in those copies that are wanted. Where it ends an episode, the next one starts.

        Args:
            power: The power of each copy's engines.
            wanted: Which copies to step.
            next_seeds: The seed of each copy's next episode.

        Returns:
            The results, with the true last observation of every episode that ended.
        """
        observation, reward = np.zeros((self.number, FEATURES), np.float32), np.zeros(self.number)
        ends = np.zeros((self.number, 2), bool)
        which = np.flatnonzero(wanted)
        following = self.observation
        _step(self._landings, which, power, next_seeds, observation, following, reward, ends, self._lanes)
        return StepResult(observation, reward, ends[:, 0], ends[:, 1])


def rollout(
    trees: Any,
    power: Float64[ndarray, "trees nodes 2"],
    tree: Int32[ndarray, " jobs"],
    seeds: UInt64[ndarray, " jobs"],
) -> tuple[Float64[ndarray, " jobs"], Int32[ndarray, " jobs"]]:
    """Play whole episodes.

    Args:
        trees: Arrays ``feature``, ``threshold``, ``left`` and ``right`` ``[trees, nodes]``, where a leaf is its own
            child.
        power: The power of the engines in each leaf.
        tree: The tree that plays each episode.
        seeds: The seed of each episode.

    Returns:
        Returns and lengths.
    """
    returns, lengths, _ = _rollouts(trees, power, tree, seeds, 0, _UNOBSERVED)
    return returns[0], lengths[0]


def observe(
    trees: Any, power: Float64[ndarray, "trees nodes 2"], seeds: UInt64[ndarray, " jobs"]
) -> Float32[ndarray, "steps features"]:
    """Return what the first of the trees observes in whole episodes, one row a step; arguments as of `rollout`."""
    observations = np.zeros((len(seeds), LIMIT, FEATURES), np.float32)
    _, lengths, _ = _rollouts(trees, power, np.zeros(len(seeds), np.int32), seeds, 0, observations)
    return observations[np.arange(LIMIT) < lengths[0][:, None]]


def rollout_similar(
    trees: Any, power: Float64[ndarray, "trees nodes 2"], seeds: UInt64[ndarray, " episodes"]
) -> tuple[Float64[ndarray, "trees episodes"], Int32[ndarray, "trees episodes"], int]:
    """Play every episode with every tree, where most trees act mostly like the first one; arguments as of `rollout`.

    Returns:
        Returns, lengths, and the number of steps taken: those in which trees act alike are taken once.
    """
    return _rollouts(trees, power, np.zeros(len(seeds), np.int32), seeds, len(power) - 1, _UNOBSERVED)


class Batch(NamedTuple):
    """Memory for some episodes that are being played."""

    landings: Landing
    raw: tuple[ndarray, ...]
    """The same memory, a row of bytes for each episode."""
    observation: Float32[ndarray, "batch features"]
    episode: Shaped[ndarray, " batch"]
    """`EPISODE`"""


def _rollouts(
    trees: Any, power: ndarray, tree: ndarray, seeds: ndarray, followers: int, observations: ndarray
) -> tuple[ndarray, ndarray, int]:
    """Play each episode with its tree and with the followers, which are the trees from the second on.

    Fills ``observations`` for as many episodes as it has rows. Returns returns and lengths
    ``[1 + followers, episodes]``, and the number of steps.
    """
    shape = 1 + followers, len(seeds)
    returns, lengths = np.zeros(shape), np.zeros(shape, np.int32)
    number = min(MAX_RUNNING, len(seeds) * shape[0])
    batches = _allocate(number), _allocate(number * followers)
    splits = trees.feature, trees.threshold, trees.left, trees.right
    results = np.zeros((number, 2)), np.zeros(number), np.zeros((number, 2), bool)
    alike = np.zeros((number, followers), np.int64)
    steps = _rollout(
        *batches,
        allocate_lanes(),
        alike,
        *results,
        splits,
        power,
        tree,
        seeds,
        returns,
        lengths,
        observations,
    )
    return returns, lengths, steps


def _allocate(number: int) -> Batch:
    landings = allocate_landings(number)
    raw = tuple(part.reshape(number, part[:1].size).view(np.uint8) for part in landings)
    return Batch(landings, raw, np.zeros((number, FEATURES), np.float32), np.zeros(number, EPISODE))


@compiled
def _start(landings, which, seeds, observation, lanes):
    landings, lanes = borrowed_landings(landings), borrowed_lanes(lanes)
    for at in which:
        start(landings, at, seeds[at], observation[at], lanes)


@compiled
def _step(landings, wanted, power, seeds, observation, following, reward, ends, lanes):
    landings, lanes = borrowed_landings(landings), borrowed_lanes(lanes)
    step(landings, wanted, power, observation, reward, ends, lanes)
    for at in wanted:
        if ends[at, 0] or ends[at, 1]:
            start(landings, at, seeds[at], following[at], lanes)
        else:
            following[at] = observation[at]


@compiled
def _leaf(splits, t, x):
    feature, threshold, left, right = splits
    node = 0
    while left[t, node] != node:
        node = left[t, node] if x[feature[t, node]] <= threshold[t, node] else right[t, node]
    return node


@compiled
def _copy(source, at, target, to):
    """Copy an episode from one batch to another."""
    for part in range(len(source.raw)):
        target.raw[part][to] = source.raw[part][at]
    target.observation[to], target.episode[to] = source.observation[at], source.episode[at]


@compiled
def _borrowed_batch(batch):
    """Return the batch, borrowed; see `machine.borrowed`."""
    return Batch(
        borrowed_landings(batch.landings), batch.raw, borrowed(batch.observation), borrowed(batch.episode)
    )


@compiled
def _rollout(
    running,
    waiting,
    lanes,
    alike,
    power,
    reward,
    ends,
    splits,
    leaf_power,
    tree,
    seeds,
    returns,
    lengths,
    observed,
):
    """See `_rollouts`. A follower shares its leader's episode until it acts differently; then its copy waits to run."""
    number, followers = len(running.episode), len(returns) - 1
    lanes, running, alike = borrowed_lanes(lanes), _borrowed_batch(running), borrowed(alike)
    power, reward = borrowed(power), borrowed(reward)
    ends, leaf_power = borrowed(ends), borrowed(leaf_power)
    splits = borrowed(splits[0]), borrowed(splits[1]), borrowed(splits[2]), borrowed(splits[3])
    active, busy = np.empty(number, np.int64), np.zeros(number, np.bool_)
    num_alike = np.zeros(number, np.int64)
    num_waiting, num_started, steps = 0, 0, 0
    while True:
        num_active = 0
        for at in range(number):
            if not busy[at] and num_waiting > 0:
                num_waiting -= 1
                _copy(waiting, num_waiting, running, at)
                busy[at] = True
            elif not busy[at] and num_started < len(seeds):
                start(running.landings, at, seeds[num_started], running.observation[at], lanes)
                episode = running.episode[at]
                episode.job, episode.tree, episode.row = num_started, tree[num_started], 0
                episode.length, episode.total = 0, 0.0
                for follower in range(followers):
                    alike[at, follower] = follower + 1
                num_alike[at], busy[at] = followers, True
                num_started += 1
            if busy[at]:
                active[num_active] = at
                num_active += 1
        if num_active == 0:
            return steps
        for at in active[:num_active]:
            episode, x = running.episode[at], running.observation[at]
            if episode.job < len(observed):
                observed[episode.job, episode.length] = x
            action = leaf_power[episode.tree, _leaf(splits, episode.tree, x)]
            power[at] = action
            num_kept = 0
            for i in range(num_alike[at]):
                t = alike[at, i]
                other = leaf_power[t, _leaf(splits, t, x)]
                if other[0] == action[0] and other[1] == action[1]:
                    alike[at, num_kept] = t
                    num_kept += 1
                    continue
                _copy(running, at, waiting, num_waiting)
                waiting.episode[num_waiting].tree = waiting.episode[num_waiting].row = t
                num_waiting += 1
            num_alike[at] = num_kept
        step(running.landings, active[:num_active], power, running.observation, reward, ends, lanes)
        steps += num_active
        for at in active[:num_active]:
            episode = running.episode[at]
            episode.total += reward[at]
            episode.length += 1
            if not (ends[at, 0] or ends[at, 1]):
                continue
            returns[episode.row, episode.job] = episode.total
            lengths[episode.row, episode.job] = episode.length
            for t in alike[at, : num_alike[at]]:
                returns[t, episode.job], lengths[t, episode.job] = episode.total, episode.length
            busy[at], num_alike[at] = False, 0
