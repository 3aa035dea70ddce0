"""Reading a run opens no environment of Gymnasium's, and its spaces are those of the environment."""

from __future__ import annotations

from collections import OrderedDict
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import tomli_w
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Text, Tuple

import sympol
from sympol.bounded import parse_toml
from sympol.cli.app import main
from sympol.envs.recorded import Recorded, record
from sympol.envs.spaces import Features
from sympol.runs.run import Run, RunError
from tests.tiny import TINY

SPACES = [
    Box(-1, 1, (3,)),
    Box(np.float32([-1, -np.inf, 0]), np.float32([0.1, np.inf, 3])),
    Box(0, 255, (2, 2), np.uint8),
    Box(-2, 2, (), np.float64),
    Discrete(4, start=-2),
    MultiDiscrete([2, 3], start=[1, 0]),
    MultiBinary(3),
    MultiBinary((2, 2)),
    Tuple((Discrete(2), Box(0, 1, (1,)))),
    Dict(OrderedDict(b=Box(0, 1, (1,)), a=Dict(c=Discrete(2)))),
]


def spec_of(observation_space: Any) -> Any:
    features = SimpleNamespace(integers=(1,))
    return SimpleNamespace(
        env=None,
        observation_space=observation_space,
        action_space=Discrete(2),
        max_episode_steps=None,
        features=features,
    )


@pytest.mark.parametrize("space", SPACES, ids=str)
def test_a_space_comes_back_as_it_was(space):
    content = parse_toml(tomli_w.dumps(record(spec_of(space))), "it")
    read = Recorded.from_dict(content)
    assert read.observation_space == space
    assert read.observation_space.dtype == space.dtype
    assert (read.action_space, read.max_episode_steps, read.integers) == (Discrete(2), None, (1,))
    assert Features.of(read.observation_space).names == Features.of(space).names


@pytest.mark.parametrize("space", [Text(3), Box(0, 1, (400, 400)), Tuple((Text(2),))], ids=str)
def test_what_cannot_be_recorded_is_left_out(space):
    assert record(spec_of(space)) == {}


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "Env"},
        {"shape": [10**9]},
        {"shape": [-1]},
        {"dtype": "O"},
        {"low": "x"},
        {"low": [0.0]},
        {"high": []},
    ],
    ids=str,
)
def test_a_damaged_record_is_refused(change):
    content = record(spec_of(Box(np.float32([0, 1]), np.float32([1, 2]))))
    content["observation_space"] |= change
    with pytest.raises(ValueError, match="not the spaces of an environment"):
        Recorded.from_dict(content)


class Counting(gymnasium.Env):
    """Counts how often it is made."""

    made = 0
    high = 1

    def __init__(self) -> None:
        Counting.made += 1
        self.observation_space = Box(-1, self.high, (2,))
        self.action_space = Discrete(3, start=1)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return self.np_random.uniform(-1, 1, 2).astype(np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return self.np_random.uniform(-1, 1, 2).astype(np.float32), float(action), False, False, {}


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    monkeypatch.setattr(gymnasium, "registry", gymnasium.envs.registration.registry)
    gymnasium.register("Counting-v0", entry_point=Counting, max_episode_steps=5)
    agent = sympol.PPO("tree", "Counting-v0", **{**TINY, "total_timesteps": 128, "num_evals": 1})
    agent.learn(progress_bar=False)
    agent.save(tmp_path / "run")
    monkeypatch.setattr(Counting, "made", 0)
    return tmp_path / "run", agent


def test_loading_and_predicting_open_no_environment(run):
    path, agent = run
    loaded = sympol.load(path)
    observations = np.random.default_rng(0).uniform(-1, 1, (9, 2)).astype(np.float32)
    np.testing.assert_array_equal(loaded.predict(observations)[0], agent.predict(observations)[0])
    assert loaded.tree() == agent.tree()
    spec, known = loaded.spec, agent.spec
    assert (spec.name, spec.backend, spec.max_episode_steps) == ("Counting-v0", "host", 5)
    assert (spec.observation_space, spec.action_space) == (known.observation_space, known.action_space)
    assert (spec.preset_id, spec.has_one_copy, spec.actions) == ("Counting-v0", False, known.actions)
    assert Counting.made == 0
    assert sympol.evaluate_policy(loaded, spec, 3) == sympol.evaluate_policy(agent, known, 3)
    assert Counting.made > 0


def test_a_command_that_reads_a_run_opens_none(run, capsys):
    assert main(["show", str(run[0])]) == 0
    assert main(["eval", str(run[0]), "--episodes", "2"]) == 0
    assert Counting.made > 0


def test_a_folder_without_spaces_has_its_environment_made(run):
    path, agent = run
    config = path / "config.toml"
    content = parse_toml(config.read_text(), "it")
    assert content["run"].pop("spaces")
    config.write_text(tomli_w.dumps(content))
    assert sympol.load(path).tree() == agent.tree()
    assert Counting.made > 0


def test_a_folder_with_damaged_spaces_is_refused(run):
    path, _ = run
    config = path / "config.toml"
    content = parse_toml(config.read_text(), "it")
    content["run"]["spaces"]["action_space"]["n"] = "many"
    config.write_text(tomli_w.dumps(content))
    with pytest.raises(RunError, match="not the spaces of an environment"):
        Run.open(path).resolve_env()


def test_an_environment_that_has_changed_since_is_not_played(run, monkeypatch):
    path, _ = run
    loaded = sympol.load(path)
    monkeypatch.setattr(Counting, "high", 2)
    with pytest.raises(
        ValueError, match=r"Counting-v0 has changed since this run was saved: its observation_space was"
    ):
        sympol.evaluate_policy(loaded, loaded.spec, 1)
    named = sympol.load(path, env="Counting-v0")
    assert named.spec.observation_space.high[0] == 2


def test_the_lunar_lander_of_a_run_is_loaded_without_box2d(tmp_path, monkeypatch):
    sympol.PPO("tree", "LunarLander-v3", num_envs=1).save(tmp_path / "run")
    monkeypatch.setattr(gymnasium, "make", None)
    spec = sympol.load(tmp_path / "run").spec
    assert spec.features.integers == (6, 7)
    assert spec.backend in ("native", "host")
