"""Many episodes side by side, and whole episodes flown by trees: what others call.

Seeds are numbers below 2^64. Engines are float64 ``[..., 2]``: the power of the main one, and that of a side one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Shaped, UInt64
from numpy import ndarray

from .lander import FEATURES, LIMIT, start, step
from .layout import Landing, landings
from .machine import compiled

_BY_ACTION = np.array([[0, 0], [0, -1], [1, 0], [0, 1]], np.float64)
"""Nothing, the left engine, the main one, the right one."""


class Moved(NamedTuple):
    """What a step of some copies led to; rows of copies that were not wanted are zeros."""

    observation: Float32[ndarray, "copies features"]
    reward: Float64[ndarray, " copies"]
    terminated: Bool[ndarray, " copies"]
    truncated: Bool[ndarray, " copies"]


def engines(actions: Shaped[ndarray, "*batch"] | Shaped[ndarray, "*batch 2"]) -> Float64[ndarray, "*batch 2"]:
    """What an action sets going: one of four, or two numbers between -1 and 1."""
    if actions.dtype.kind in "iu":
        return _BY_ACTION[actions]
    wanted = np.clip(actions.astype(np.float64), -1, 1)
    main, side = wanted[..., 0], wanted[..., 1]
    return np.stack(
        [np.where(main > 0, (main + 1) * 0.5, 0.0), np.where(np.abs(side) > 0.5, side, 0.0)], axis=-1
    )


class Flights:
    """Some episodes, each at its own point; who ends one begins the next."""

    def __init__(self, seeds: UInt64[ndarray, " copies"]) -> None:
        self._landings, self.number = landings(len(seeds)), len(seeds)
        self.observation = np.zeros((self.number, FEATURES), np.float32)
        """What the next actions answer to."""
        _start(self._landings, seeds, self.observation)

    def step(self, push: Float64[ndarray, "copies 2"], wanted: Bool[ndarray, " copies"]) -> Moved:
        """One step of those that are wanted. Where it ends an episode, the next one has begun."""
        seen, reward = np.zeros((self.number, FEATURES), np.float32), np.zeros(self.number)
        over = np.zeros((2, self.number), bool)
        _step(self._landings, push, wanted, seen, self.observation, reward, over)
        return Moved(seen, reward, over[0], over[1])


def fly(
    trees: Any,
    push: Float64[ndarray, "trees nodes 2"],
    tree: Int32[ndarray, " jobs"],
    seeds: UInt64[ndarray, " jobs"],
) -> tuple[Float64[ndarray, " jobs"], Int32[ndarray, " jobs"]]:
    """Whole episodes; returns and lengths. ``trees`` has feature, threshold, left and right ``[trees, nodes]``, where a
    leaf is its own child; ``tree`` says who flies which episode."""
    returns, lengths = np.zeros(len(seeds)), np.zeros(len(seeds), np.int32)
    _fly(landings(1), _asks(trees), push, tree, seeds, returns, lengths, np.zeros((0, FEATURES), np.float32))
    return returns, lengths


def watch(
    trees: Any, push: Float64[ndarray, "trees nodes 2"], seeds: UInt64[ndarray, " jobs"]
) -> Float32[ndarray, "steps features"]:
    """What the first of the trees sees in whole episodes, one row a step."""
    seen = np.zeros((LIMIT * len(seeds), FEATURES), np.float32)
    tree, lengths = np.zeros(len(seeds), np.int32), np.zeros(len(seeds), np.int32)
    _fly(landings(1), _asks(trees), push, tree, seeds, np.zeros(len(seeds)), lengths, seen)
    return seen[: lengths.sum()]


def fly_changed(
    trees: Any, push: Float64[ndarray, "trees nodes 2"], seeds: UInt64[ndarray, " episodes"]
) -> tuple[Float64[ndarray, "trees episodes"], Int32[ndarray, "trees episodes"], int]:
    """As `fly`, every tree in every episode, where most do as the first does: what they do alike is flown once.

    Also how many steps that took.
    """
    shape = len(push), len(seeds)
    returns, lengths, steps = np.zeros(shape), np.zeros(shape, np.int32), np.zeros(1, np.int64)
    first, others = landings(1), landings(len(push))
    _fly_changed(
        first, others, _bytes(first), _bytes(others), _asks(trees), push, seeds, returns, lengths, steps
    )
    return returns, lengths, int(steps[0])


def _asks(trees: Any) -> tuple[ndarray, ...]:
    return trees.feature, trees.threshold, trees.left, trees.right


def _bytes(all_landings: Landing) -> tuple[ndarray, ...]:
    """The same memory, a row for each landing."""
    return tuple(part.reshape(len(part), -1).view(np.uint8) for part in all_landings)


@compiled
def _one(all_landings, i):
    return Landing(
        all_landings.bodies[i],
        all_landings.joints[i],
        all_landings.contacts[i],
        all_landings.points[i],
        all_landings.edges[i],
        all_landings.game[i],
    )


@compiled
def _start(all_landings, seeds, observation):
    for i in range(len(seeds)):
        start(_one(all_landings, i), seeds[i], observation[i])


@compiled
def _step(all_landings, push, wanted, seen, following, reward, over):
    for i in range(len(wanted)):
        if not wanted[i]:
            continue
        landing = _one(all_landings, i)
        reward[i], over[0, i], over[1, i] = step(landing, push[i, 0], push[i, 1], seen[i])
        if over[0, i] or over[1, i]:
            start(landing, landing.game[0].random, following[i])
        else:
            following[i] = seen[i]


@compiled
def _leaf(asks, t, x):
    feature, threshold, left, right = asks
    node = 0
    while left[t, node] != node:
        node = left[t, node] if x[feature[t, node]] <= threshold[t, node] else right[t, node]
    return node


@compiled
def _fly_on(landing, asks, push, t, x, total, length, seen):
    """A tree from what it sees now to the end; the return and length of all of the episode. Fills ``seen``, in so far
    as there is room."""
    row, over = 0, False
    while not over:
        if row < len(seen):
            seen[row] = x
            row += 1
        node = _leaf(asks, t, x)
        reward, terminated, truncated = step(landing, push[t, node, 0], push[t, node, 1], x)
        total += reward
        length += 1
        over = terminated or truncated
    return total, length


@compiled
def _fly(all_landings, asks, push, tree, seeds, returns, lengths, seen):
    landing, x, row = _one(all_landings, 0), np.zeros(FEATURES, np.float32), 0
    for job in range(len(seeds)):
        start(landing, seeds[job], x)
        returns[job], lengths[job] = _fly_on(landing, asks, push, tree[job], x, 0.0, 0, seen[row:])
        row += lengths[job]


@compiled
def _fly_changed(first, others, first_bytes, others_bytes, asks, push, seeds, returns, lengths, steps):
    number = len(push)
    landing, x = _one(first, 0), np.zeros(FEATURES, np.float32)
    seen = np.zeros((number, FEATURES), np.float32)
    alike, alone = np.zeros(number, np.int64), np.zeros(number, np.int64)
    for episode in range(len(seeds)):
        start(landing, seeds[episode], x)
        total, length, over = 0.0, 0, False
        together, apart = number, 0
        for t in range(number):
            alike[t] = t
        while not over:
            node = _leaf(asks, 0, x)
            still = 0
            for i in range(together):
                t = alike[i]
                its = _leaf(asks, t, x)
                if push[t, its, 0] == push[0, node, 0] and push[t, its, 1] == push[0, node, 1]:
                    alike[still] = t
                    still += 1
                    continue
                for part in range(len(first_bytes)):  # from here on it flies alone
                    others_bytes[part][t] = first_bytes[part][0]
                seen[t], returns[t, episode], lengths[t, episode] = x, total, length
                alone[apart] = t
                apart += 1
            together = still
            reward, terminated, truncated = step(landing, push[0, node, 0], push[0, node, 1], x)
            total += reward
            length += 1
            over = terminated or truncated
        for i in range(together):
            returns[alike[i], episode], lengths[alike[i], episode] = total, length
        steps[0] += length
        for i in range(apart):
            t = alone[i]
            so_far, before = returns[t, episode], lengths[t, episode]
            total, length = _fly_on(_one(others, t), asks, push, t, seen[t], so_far, before, seen[:0])
            returns[t, episode], lengths[t, episode] = total, length
            steps[0] += length - before
