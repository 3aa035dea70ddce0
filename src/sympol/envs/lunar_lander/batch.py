"""Many episodes side by side, and whole episodes flown by trees: what others call.

Seeds are numbers below 2^64. Engines are float64 ``[..., 2]``: the power of the main one, and that of a side one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Shaped, UInt64
from numpy import ndarray

from .lander import FEATURES, LIMIT, start, step
from .layout import Landing, abreast, landings, lent_abreast, lent_landings
from .machine import compiled, lent

_BY_ACTION = np.array([[0, 0], [0, -1], [1, 0], [0, 1]], np.float64)
"""Nothing, the left engine, the main one, the right one."""
MOST = 64
"""Landings at a time: enough that there are always some beside each other that stand, and some in the air."""
FLYER = np.dtype([("job", "i8"), ("tree", "i8"), ("row", "i8"), ("length", "i8"), ("total", "f8")])
"""Which episode is flown by which tree, and what it has come to; ``row`` says where the return goes."""
_UNSEEN = np.zeros((0, LIMIT, FEATURES), np.float32)


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


class Flyers(NamedTuple):
    """Some episodes under way."""

    landings: Landing
    same: tuple[ndarray, ...]
    """The same memory, a row of bytes for each of them."""
    seen: Float32[ndarray, "flyers features"]
    who: Shaped[ndarray, " flyers"]
    """`FLYER`"""


class Flights:
    """Some episodes, each at its own point; who ends one begins the next."""

    def __init__(self, seeds: UInt64[ndarray, " copies"]) -> None:
        self._landings, self._room, self.number = landings(len(seeds)), abreast(), len(seeds)
        self.observation = np.zeros((self.number, FEATURES), np.float32)
        """What the next actions answer to."""
        _start(self._landings, seeds, self.observation, self._room)

    def step(self, push: Float64[ndarray, "copies 2"], wanted: Bool[ndarray, " copies"]) -> Moved:
        """One step of those that are wanted. Where it ends an episode, the next one has begun."""
        seen, reward = np.zeros((self.number, FEATURES), np.float32), np.zeros(self.number)
        over = np.zeros((self.number, 2), bool)
        _step(self._landings, np.flatnonzero(wanted), push, seen, self.observation, reward, over, self._room)
        return Moved(seen, reward, over[:, 0], over[:, 1])


def fly(
    trees: Any,
    push: Float64[ndarray, "trees nodes 2"],
    tree: Int32[ndarray, " jobs"],
    seeds: UInt64[ndarray, " jobs"],
) -> tuple[Float64[ndarray, " jobs"], Int32[ndarray, " jobs"]]:
    """Whole episodes; returns and lengths. ``trees`` has feature, threshold, left and right ``[trees, nodes]``, where a
    leaf is its own child; ``tree`` says who flies which episode."""
    returns, lengths, _ = _flown(trees, push, tree, seeds, 0, _UNSEEN)
    return returns[0], lengths[0]


def watch(
    trees: Any, push: Float64[ndarray, "trees nodes 2"], seeds: UInt64[ndarray, " jobs"]
) -> Float32[ndarray, "steps features"]:
    """What the first of the trees sees in whole episodes, one row a step."""
    seen = np.zeros((len(seeds), LIMIT, FEATURES), np.float32)
    _, lengths, _ = _flown(trees, push, np.zeros(len(seeds), np.int32), seeds, 0, seen)
    return seen[np.arange(LIMIT) < lengths[0][:, None]]


def fly_changed(
    trees: Any, push: Float64[ndarray, "trees nodes 2"], seeds: UInt64[ndarray, " episodes"]
) -> tuple[Float64[ndarray, "trees episodes"], Int32[ndarray, "trees episodes"], int]:
    """As `fly`, every tree in every episode, where most do as the first does: what they do alike is flown once.

    Also how many steps that took.
    """
    return _flown(trees, push, np.zeros(len(seeds), np.int32), seeds, len(push) - 1, _UNSEEN)


def _flown(
    trees: Any, push: ndarray, tree: ndarray, seeds: ndarray, followers: int, seen: ndarray
) -> tuple[ndarray, ndarray, int]:
    """Each episode is flown by its tree, and by the followers, the trees from the second on. Returns and lengths
    ``[1 + followers, episodes]``, and steps; fills ``seen``, in so far as there is room."""
    shape = 1 + followers, len(seeds)
    returns, lengths = np.zeros(shape), np.zeros(shape, np.int32)
    flying = min(MOST, len(seeds) * shape[0])
    flyers = _flyers(flying), _flyers(flying * followers)
    asks = trees.feature, trees.threshold, trees.left, trees.right
    moved = np.zeros((flying, 2)), np.zeros(flying), np.zeros((flying, 2), bool)
    alike = np.zeros((flying, followers), np.int64)
    steps = _fly(*flyers, abreast(), alike, *moved, asks, push, tree, seeds, returns, lengths, seen)
    return returns, lengths, steps


def _flyers(number: int) -> Flyers:
    flown = landings(number)
    same = tuple(part.reshape(number, part[:1].size).view(np.uint8) for part in flown)
    return Flyers(flown, same, np.zeros((number, FEATURES), np.float32), np.zeros(number, FLYER))


@compiled
def _start(all_landings, seeds, observation, room):
    all_landings, room = lent_landings(all_landings), lent_abreast(room)
    for at in range(len(seeds)):
        start(all_landings, at, seeds[at], observation[at], room)


@compiled
def _step(all_landings, wanted, push, seen, following, reward, over, room):
    all_landings, room = lent_landings(all_landings), lent_abreast(room)
    step(all_landings, wanted, push, seen, reward, over, room)
    for at in wanted:
        if over[at, 0] or over[at, 1]:
            start(all_landings, at, all_landings.game[at, 0].random, following[at], room)
        else:
            following[at] = seen[at]


@compiled
def _leaf(asks, t, x):
    feature, threshold, left, right = asks
    node = 0
    while left[t, node] != node:
        node = left[t, node] if x[feature[t, node]] <= threshold[t, node] else right[t, node]
    return node


@compiled
def _copy(source, at, target, to):
    """Let a flyer be another's double."""
    for part in range(len(source.same)):
        target.same[part][to] = source.same[part][at]
    target.seen[to], target.who[to] = source.seen[at], source.who[at]


@compiled
def _lent_flyers(held):
    """See `machine.lent`."""
    return Flyers(lent_landings(held.landings), held.same, lent(held.seen), lent(held.who))


@compiled
def _fly(
    flying, waiting, room, alike, power, reward, over, asks, push, tree, seeds, returns, lengths, watched
):
    """See `_flown`. A follower flies with its leader until it does something else, and waits then for a lane."""
    number, followers = len(flying.who), len(returns) - 1
    room, flying, alike = lent_abreast(room), _lent_flyers(flying), lent(alike)
    power, reward, over, push = lent(power), lent(reward), lent(over), lent(push)
    asks = lent(asks[0]), lent(asks[1]), lent(asks[2]), lent(asks[3])
    which, busy, together = (
        np.empty(number, np.int64),
        np.zeros(number, np.bool_),
        np.zeros(number, np.int64),
    )
    waits, begun, steps = 0, 0, 0
    while True:
        flies = 0
        for at in range(number):
            if not busy[at] and waits > 0:
                waits -= 1
                _copy(waiting, waits, flying, at)
                busy[at] = True
            elif not busy[at] and begun < len(seeds):
                start(flying.landings, at, seeds[begun], flying.seen[at], room)
                who = flying.who[at]
                who.job, who.tree, who.row, who.length, who.total = begun, tree[begun], 0, 0, 0.0
                for follower in range(followers):
                    alike[at, follower] = follower + 1
                together[at], busy[at] = followers, True
                begun += 1
            if busy[at]:
                which[flies] = at
                flies += 1
        if flies == 0:
            return steps
        for at in which[:flies]:
            who, x = flying.who[at], flying.seen[at]
            if who.job < len(watched):
                watched[who.job, who.length] = x
            action = push[who.tree, _leaf(asks, who.tree, x)]
            power[at] = action
            still = 0
            for i in range(together[at]):
                t = alike[at, i]
                other = push[t, _leaf(asks, t, x)]
                if other[0] == action[0] and other[1] == action[1]:
                    alike[at, still] = t
                    still += 1
                    continue
                _copy(flying, at, waiting, waits)
                waiting.who[waits].tree = waiting.who[waits].row = t
                waits += 1
            together[at] = still
        step(flying.landings, which[:flies], power, flying.seen, reward, over, room)
        steps += flies
        for at in which[:flies]:
            who = flying.who[at]
            who.total += reward[at]
            who.length += 1
            if not (over[at, 0] or over[at, 1]):
                continue
            returns[who.row, who.job], lengths[who.row, who.job] = who.total, who.length
            for t in alike[at, : together[at]]:
                returns[t, who.job], lengths[t, who.job] = who.total, who.length
            busy[at], together[at] = False, 0
