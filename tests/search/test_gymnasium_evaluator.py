"""The evaluator on the host: what Gymnasium's own loop brings."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

from sympol.envs.registry import resolve
from sympol.play import episode_seed, play
from sympol.search.evaluators import gymnasium as hosted
from sympol.search.evaluators import make_evaluator

from .loops import SEED, grown


def test_on_gymnasium_it_is_what_play_brings():
    """Validation episodes have the seeds that `sympol.play` gives them: the same returns, to the bit."""
    spec = resolve("CartPole-v1", backend="host")
    trees = [grown(spec, n, n) for n in (2, 5, 40)]
    evaluator = make_evaluator(spec, SEED, "validation")
    assert isinstance(evaluator, hosted.GymnasiumEvaluator)
    played = evaluator.play(trees, range(50))
    for tree, returns, lengths in zip(trees, *played, strict=True):
        there = play(tree, spec, 50, seed=SEED, purpose="validation")
        np.testing.assert_array_equal(returns, there.returns)
        np.testing.assert_array_equal(lengths, there.lengths)


class Counter(gymnasium.Env):
    """Starts at its seed's number and never ends; an action from 5 on, several observations of other types."""

    observation_space = gymnasium.spaces.Dict(
        {"kind": gymnasium.spaces.Discrete(3), "n": gymnasium.spaces.Box(-10, 10, (2,), np.float64)}
    )
    action_space = gymnasium.spaces.Discrete(2, start=5)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.n = self.np_random.uniform(-1, 1, 2)
        return self._see(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert self.action_space.contains(action), action
        self.n = self.n + (0.1 if action == 5 else -0.1) + self.np_random.normal(size=2) / 50
        return self._see(), float(self.n[0]), bool(abs(self.n[0]) > 1.3), False, {}

    def _see(self) -> dict[str, Any]:
        return {"kind": int(abs(self.n[1]) * 10) % 3, "n": self.n}


@pytest.mark.parametrize("one_copy", [False, True])
def test_any_observations_and_actions_and_the_clock_of_the_arena(one_copy):
    spec = resolve(Counter() if one_copy else Counter)
    assert spec.has_one_copy is one_copy
    trees, limit = [grown(spec, n, n) for n in (2, 6, 12)], 60
    evaluator = hosted.GymnasiumEvaluator(spec, SEED)
    evaluator._limit = limit
    played = evaluator.play(trees, range(4, 7))
    for i, tree in enumerate(trees):
        for j, episode in enumerate(range(4, 7)):
            env, seen = Counter(), []
            x, total, over = env.reset(seed=episode_seed(SEED, episode, "refine"))[0], 0.0, False
            while not over and len(seen) < limit:
                seen.append(spec.features.flatten(x))
                x, reward, over, _, _ = env.step(tree.predict(seen[-1]))
                total += reward
            assert played.returns[i, j] == np.float32(total)
            assert played.lengths[i, j] == len(seen)
            np.testing.assert_array_equal(
                evaluator.observe(tree, range(episode, episode + 1)), np.stack(seen)
            )
