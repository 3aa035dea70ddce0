"""The arena in machine code: what copies that are stepped one by one bring."""

from __future__ import annotations

import numpy as np
import pytest

from sympol.envs.lunar_lander.flights import Flights, engines
from sympol.envs.registry import resolve
from sympol.play import episode_seed
from sympol.refine.arena import make_arena
from sympol.refine.flown import FlownArena

from .loops import SEED, grown


@pytest.mark.parametrize("name", ["LunarLander-v3", "LunarLanderContinuous-v3"])
def test_whole_episodes_are_those_of_single_steps(name):
    spec = resolve(name, backend="native")
    trees, episodes, every = [grown(spec, n, n) for n in (3, 20)], range(70, 75), np.ones(1, bool)
    arena = make_arena(spec, SEED)
    assert isinstance(arena, FlownArena)
    played = arena.play(trees, episodes)
    for i, tree in enumerate(trees):
        for j, episode in enumerate(episodes):
            flight = Flights(np.array([episode_seed(SEED, episode, "refine")], np.uint64))
            seen, total, over = [], 0.0, False
            while not over:
                seen.append(flight.observation[0].copy())
                moved = flight.step(engines(np.asarray(tree.predict(seen[-1]))[None]), every)
                total += float(moved.reward[0])
                over = bool(moved.terminated[0] or moved.truncated[0])
            assert played.lengths[i, j] == len(seen)
            assert played.returns[i, j] == np.float32(total)
            np.testing.assert_array_equal(arena.observe(tree, range(episode, episode + 1)), np.stack(seen))


def test_threads_change_nothing(monkeypatch):
    spec = resolve("LunarLander-v3", backend="native")
    trees = [grown(spec, n, n) for n in (3, 20)]
    played = []
    for threads in ("1", "3"):
        monkeypatch.setenv("PJRT_NPROC", threads)
        played.append(make_arena(spec, SEED).play(trees, range(8)))
    for one, other in zip(*played, strict=True):
        np.testing.assert_array_equal(one, other)
