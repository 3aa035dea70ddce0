"""A policy that earns far more, or less, when it samples its actions than with its best ones is warned of."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from sympol.training import NeedsNoise, warn_of_noise

from .tiny import flags, status_of

RNG = np.random.default_rng(0)


def around(mean: float, std: float, number: int = 20) -> np.ndarray:
    """Returns with just this mean and spread."""
    x = RNG.normal(size=number)
    return mean + std * (x - x.mean()) / x.std()


@pytest.mark.parametrize(
    ("best", "sampled", "said"),
    [
        (np.zeros(20), around(0.94, 0.02), r"earns 0.000 with its best .* 0.940 .*\(--ent-end-factor -1\)"),
        (np.repeat([0.0, 0.94], 10), around(0.94, 0.02), "it relies on its noise"),
        (around(-200, 0.0), around(-90, 20), "it relies on its noise"),
        (around(500, 0.0), around(60, 40), r"earns 500.0 with its best .* 60.0 .*\(--ent-coef"),
    ],
    ids=["DoorKey", "half of DoorKey", "MountainCar", "half trained"],
)
def test_far_apart(best, sampled, said):
    with pytest.warns(NeedsNoise, match=said):
        warn_of_noise("X-v0", best, sampled)


@pytest.mark.parametrize(
    ("best", "sampled"),
    [
        (around(500, 0.0), around(490, 5)),
        (around(500, 0.0), around(400, 90)),
        (around(258, 24), around(111, 50)),
        (around(-150, 80), around(-250, 90)),
        (around(100, 120), around(140, 110)),
        (np.zeros(20), np.zeros(20)),
        (np.zeros(3), np.ones(3)),
    ],
    ids=[
        "CartPole",
        "CartPole, half trained",
        "CartPole, at first",
        "Pendulum",
        "LunarLander",
        "nothing",
        "few",
    ],
)
def test_no_warning_of_what_noise_and_chance_do(best, sampled):
    warn_of_noise("X-v0", best, sampled)  # a warning would be an error


class Guess(gymnasium.Env):
    """Nothing is observed; the same action as last time costs, so that a coin earns more than any choice."""

    observation_space, action_space = Box(-1, 1, (1,)), Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time, self.before = 0, None
        return np.zeros(1, np.float32), {}

    def step(self, action):
        reward = float(action != self.before)
        self.time, self.before = self.time + 1, action
        return np.zeros(1, np.float32), reward, self.time >= 50, False, {}


def test_a_training_ends_with_the_warning_in_one_line(tmp_path, capsys):
    gymnasium.register("Guess-v0", Guess)
    given = ["Guess-v0", "--eval-episodes", "5", *flags(), "--ent-coef", "1", "--ent-end-factor", "1"]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            assert status_of("train", *given, "--run-dir", tmp_path / "run") == 0
    finally:
        del gymnasium.registry["Guess-v0"]
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]
    assert sum("on Guess-v0 the policy earns 1.0 with its best actions" in line for line in said) == 1
    assert sum("the 5 test episodes on Guess-v0 are all the same" in line for line in said) == 1
    assert len(said) == 2
