"""Another kind of environment is one module and one line in `ADAPTERS`."""

from __future__ import annotations

import subprocess
import sys

import gymnasium
import jax
import numpy as np
import pytest

import sympol
from sympol.envs.adapters import ADAPTERS, built_in
from sympol.envs.classic.cartpole import CartPole
from sympol.envs.errors import UnknownEnvironment
from sympol.envs.on_host import OnHost
from sympol.envs.registry import resolve
from tests.tiny import quick_compiles, trained

from .toy_adapter import Adapted

__all__ = ["quick_compiles"]

TOY = "toy/Ladder-v0"


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ADAPTERS, "toy/", "tests.envs.toy_adapter:Toy")


@pytest.mark.usefixtures("toy")
def test_an_adapter_resolves():
    spec = resolve(TOY)
    assert (spec.name, spec.backend, spec.max_episode_steps) == (TOY, "jax", 12)
    assert (spec.features.names, spec.actions.names) == (("rung", "time left"), ("down", "up"))
    assert spec.preset_id == TOY
    assert isinstance(resolve(TOY, backend="host").make_host(), OnHost)
    tall = resolve(TOY, env_kwargs={"height": 9})
    assert tall.env.env == Adapted(height=9)  # in a wrapper that casts its integer rewards
    assert tall.make_host().env.height == 9


@pytest.mark.usefixtures("toy", "quick_compiles")
def test_an_adapted_world_trains_evaluates_and_is_loaded(tmp_path):
    agent = trained(TOY, total_timesteps=8192)
    tree = agent.tree()
    mean, _ = sympol.evaluate_policy(tree, TOY, n_eval_episodes=20)
    assert mean == 1
    agent.save(tmp_path / "run")
    assert sympol.load(tmp_path / "run").tree() == tree


@pytest.mark.usefixtures("toy", "quick_compiles")
def test_an_adapted_world_trains_on_the_host():
    agent = trained(TOY, backend="host", total_timesteps=256)
    assert agent.spec.backend == "host"


@pytest.mark.usefixtures("toy")
def test_a_mistyped_id_is_answered_with_the_adapter_s():
    with pytest.raises(UnknownEnvironment, match="did you mean 'toy/Ladder-v0'"):
        resolve("toy/Lader-v0")


def test_the_longest_beginning_is_asked_first(monkeypatch):
    monkeypatch.setitem(ADAPTERS, "", "sympol.envs.adapters.gymnasium:Gymnasium")
    assert built_in("CartPole-v1").env == CartPole()
    assert built_in("CartPole-v0").env is None
    assert built_in("CartPole-v0").host is not None


def test_the_form_on_the_host_does_what_the_form_in_jax_does():
    env = Adapted()
    host, again = OnHost(env), OnHost(Adapted())
    observation, _ = host.reset(seed=3)
    np.testing.assert_array_equal(again.reset(seed=3)[0], observation)
    state = np.array([round(float(observation[0]) * env.height), 0], np.int32)
    ended = False
    while not ended:
        state, step = env.step(jax.random.key(0), state, 1)
        answer = host.step(1)
        np.testing.assert_allclose(answer[0], step.observation, rtol=1e-6)
        assert answer[1:4] == (float(step.reward), bool(step.terminated), bool(step.truncated))
        ended = answer[2] or answer[3]
    assert host.observation_space.contains(answer[0])
    assert isinstance(host, gymnasium.Env)
    assert host.feature_names == env.feature_names


def test_no_world_is_imported_before_it_is_asked_for():
    program = (
        "import sys; from sympol.envs.registry import resolve; resolve('FrozenLake-v1')\n"
        "names = ('classic.', 'minigrid', 'lunar_lander')\n"
        "found = [m for m in sys.modules if any(f'sympol.envs.{name}' in m for name in names)]\n"
        "assert not found, found"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
