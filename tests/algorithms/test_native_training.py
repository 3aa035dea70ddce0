"""Training in machine code: the same update as for Gymnasium, fed by another host."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sympol
from sympol.algorithms.config import Config
from sympol.algorithms.initialization import host_seed
from sympol.algorithms.trainer import Trainer
from sympol.envs.errors import MissingExtra
from sympol.envs.lunar_lander import engine
from sympol.envs.registry import resolve
from sympol.runs.run import Run
from tests.algorithms.programs import begun
from tests.algorithms.test_host_training import assert_same_bits, source_of, train
from tests.tiny import TINY, agent, flags, quick_compiles, status_of

__all__ = ["quick_compiles"]

TASK, CONTINUOUS = "LunarLander-v3", "LunarLanderContinuous-v3"
CONFIG = Config(**TINY)


@pytest.fixture(scope="module")
def in_machine_code() -> sympol.PPO:
    return agent(TASK).learn(progress_bar=False)


def test_it_trains(in_machine_code):
    assert in_machine_code.spec.backend == "native"
    assert in_machine_code.num_timesteps >= 2048
    first = begun(in_machine_code.spec, CONFIG)
    assert np.all(
        np.asarray(first.networks.actor.leaf_values) != in_machine_code.state.networks.actor.leaf_values
    )


def test_same_seed_same_bits(in_machine_code):
    assert_same_bits(agent(TASK).learn(progress_bar=False).state, in_machine_code.state)


def test_loaded_in_between_it_goes_on_to_the_same_tree(in_machine_code, tmp_path):
    stopped = agent(TASK).learn(progress_bar=False, callback=lambda report: report.timestep < 1000)
    assert 0 < stopped.num_timesteps < 2048
    stopped.save(tmp_path / "run")
    loaded = sympol.load(tmp_path / "run")
    assert loaded.spec.backend == "native"
    loaded.learn(progress_bar=False)
    assert loaded.tree().to_json() == in_machine_code.tree().to_json()
    assert_same_bits(loaded.state, in_machine_code.state)


def test_continuous_actions():
    spec = resolve(CONTINUOUS)
    first = train(spec, [512, 1024], config=CONFIG)
    assert_same_bits(train(spec, [512, 1024], config=CONFIG), first)
    assert np.isfinite(float(first.validation.last_return))


def test_validation_is_the_return_of_the_deterministic_tree():
    """Worked out here from the tree and the copies, episode by episode, none of them cut and none counted twice."""
    spec = resolve(TASK)
    trainer = Trainer(spec, CONFIG, 0)
    state: Any = trainer.advance(None, 64)
    source = source_of(spec, CONFIG)
    returns, _ = source.evaluate(state, 0)
    policy, envs = state.networks.actor.rollout(), spec.host_envs(CONFIG.num_envs)
    observation = envs.reset(host_seed(0, "validation"))
    total, alive = np.zeros(CONFIG.num_envs), np.ones(CONFIG.num_envs, bool)
    while alive.any():
        outputs = np.asarray(policy(state.normalizer(observation)))
        step, observation = envs.step(np.argmax(outputs, axis=1).astype(np.int32))
        total[alive] += step.reward[alive]
        alive &= ~(step.terminated | step.truncated)
    assert CONFIG.num_eval_episodes == CONFIG.num_envs
    np.testing.assert_allclose(returns, total, rtol=1e-6)
    trainer.close()
    source.close()


def test_the_output_and_the_folder_say_how(tmp_path, capsys, monkeypatch):
    for installed, how in (
        (True, "in machine code"),
        (False, "through Gymnasium (with Numba it trains faster: pip install 'sympol[box2d]'"),
    ):
        monkeypatch.setattr(engine, "is_installed", lambda installed=installed: installed)
        run = tmp_path / f"run{installed}"
        assert status_of("train", TASK, "--eval-episodes", "1", *flags(), "--run-dir", run) == 0
        assert how in " ".join(capsys.readouterr().err.split())
        assert Run.open(run).metadata["backend"] == ("native" if installed else "host")


def test_where_numba_is_missing_a_run_can_be_read_but_not_continued(tmp_path, monkeypatch):
    stopped = agent(TASK).learn(progress_bar=False, callback=lambda report: False)
    stopped.save(tmp_path / "run")
    monkeypatch.setattr(engine, "is_installed", lambda: False)
    loaded = sympol.load(tmp_path / "run")
    assert loaded.predict(np.zeros(8, np.float32))[0] == stopped.predict(np.zeros(8, np.float32))[0]
    sympol.evaluate_policy(loaded.tree(), loaded.spec, 2)
    with pytest.raises(MissingExtra, match=r"pip install 'sympol\[box2d\]'"):
        loaded.learn(progress_bar=False)
    assert loaded.num_timesteps == stopped.num_timesteps
