from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from sympol.envs.classic.cartpole import CartPole
from sympol.envs.entries import REGISTERED
from sympol.envs.errors import UnknownEnvironment
from sympol.envs.names import NAMES
from sympol.envs.on_host import OnHost
from sympol.envs.registry import register, resolve

from .probes import MultiDiscreteMatch

TWINS = ["CartPole-v1", "Acrobot-v1", "Pendulum-v1", "MountainCar-v0", "MountainCarContinuous-v0"]


class Homemade(gymnasium.Env):
    def __init__(self) -> None:
        self.observation_space = Box(-1, 1, (2,))
        self.action_space = Discrete(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        return np.zeros(2, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return np.zeros(2, np.float32), 0.0, False, False, {}


class Secretive(gymnasium.Wrapper):
    """Does not record its arguments, so that no spec can make it again."""


@pytest.fixture(autouse=True)
def _own_names() -> Iterator[None]:
    with patch.dict(REGISTERED):
        yield


@pytest.mark.parametrize("name", TWINS)
def test_the_five_have_a_twin_names_and_a_time_limit(name: str) -> None:
    spec = resolve(name)
    assert spec.env is not None
    theirs = spec.make_host()
    assert theirs.spec is not None
    assert (theirs.spec.id, theirs.spec.max_episode_steps) == (name, spec.max_episode_steps)
    assert (theirs.observation_space, theirs.action_space) == (spec.observation_space, spec.action_space)
    assert not any(feature.startswith("x[") for feature in spec.features.names)
    assert not any(action.startswith("action") for action in spec.actions.names)


def test_backends() -> None:
    assert resolve("CartPole-v1", backend="host").env is None
    assert resolve("CartPole-v1", backend="jax").env == CartPole()
    with pytest.raises(ValueError, match="FrozenLake-v1 is not written in JAX"):
        resolve("FrozenLake-v1", backend="jax")
    on_host = resolve(MultiDiscreteMatch(), backend="host")
    assert on_host.env is None
    assert isinstance(on_host.make_host(), OnHost)
    with pytest.raises(ValueError, match="must be one of auto, jax, native, host, got 'gpu'"):
        resolve("CartPole-v1", backend="gpu")  # type: ignore[arg-type]


def test_any_other_id() -> None:
    spec = resolve("FrozenLake-v1")
    assert spec.env is None
    assert spec.max_episode_steps == 100
    assert len(spec.features.names) == 16
    assert spec.host_envs(2).reset(seed=0).shape == (2, 16)


@pytest.mark.parametrize(
    "env", [CartPole(max_episode_steps=7), CartPole, lambda: CartPole()], ids=["object", "class", "function"]
)
def test_written_in_jax(env: Any) -> None:
    spec = resolve(env)
    assert isinstance(spec.env, CartPole)
    assert isinstance(spec.make_host(), OnHost)
    assert spec.max_episode_steps == spec.env.max_episode_steps
    assert spec.features.names[0] == "cart position (m)"
    assert spec.host_envs(2).reset(seed=0).shape == (2, 4)


def test_an_object_with_a_spec_is_made_again() -> None:
    spec = resolve(gymnasium.wrappers.TimeLimit(gymnasium.make("Pendulum-v1"), 30))
    assert (spec.name, spec.env, spec.max_episode_steps) == ("Pendulum-v1", None, 30)
    envs = spec.host_envs(2)
    envs.reset(seed=0)
    truncated = [envs.step(np.zeros((2, 1), np.float32))[0].truncated.all() for _ in range(30)]
    assert truncated == [False] * 29 + [True]


@pytest.mark.parametrize(
    "env", [Homemade(), Secretive(gymnasium.make("CartPole-v1"))], ids=["no spec", "wrapper"]
)
def test_an_object_that_cannot_be_made_again_is_one_copy(env: Any) -> None:
    spec = resolve(env)
    assert spec.has_one_copy
    assert spec.make_host() is env
    spec.host_envs(1).reset(seed=0)
    with pytest.raises(ValueError, match=r"num_envs must be 1, got 4: .* give a function that makes one"):
        spec.host_envs(4)


@pytest.mark.parametrize("factory", [Homemade, lambda: Homemade()], ids=["class", "function"])
def test_a_factory(factory: Any) -> None:
    spec = resolve(factory)
    assert (spec.name, spec.env, spec.max_episode_steps) == ("Homemade", None, None)
    assert spec.host_envs(3).reset(seed=0).shape == (3, 2)


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("CartPol-v1", "CartPole-v1"),
        ("cartpole-v1", "CartPole-v1"),
        ("CartPole", "CartPole-v1"),
        ("CartPole-v9", "CartPole-v1"),
        ("mountaincarcontinuous-v0", "MountainCarContinuous-v0"),
        ("LunarLandr-v3", "LunarLander-v3"),
        ("My-v0", "My-v1"),
        ("", "nothing known has a similar name"),
        ("no such thing", "nothing known has a similar name"),
        ("no_such_module:CartPole-v1", "there is no module no_such_module"),
    ],
)
def test_unknown_ids_are_answered_with_near_ones(name: str, near: str) -> None:
    register("My-v1", CartPole())
    with pytest.raises(UnknownEnvironment, match="unknown environment") as error:
        resolve(name)
    assert near in str(error.value)


@pytest.mark.parametrize(
    "env",
    [3, None, object(), lambda: 3],
    ids=["int", "None", "object", "lambda"],
)
def test_what_is_no_environment(env: Any) -> None:
    with pytest.raises(TypeError, match="env must be an id"):
        resolve(env)


def test_an_environment_in_jax_must_observe_a_flat_box() -> None:
    class Image(CartPole):
        @property
        def observation_space(self) -> Box:
            return Box(0, 1, (2, 2))

    with pytest.raises(ValueError, match=r"must observe a Box of shape \(features,\)"):
        resolve(Image())


def test_names_given_names_registered_and_the_environments_own() -> None:
    register("Mine-v0", CartPole(), feature_names=list("abcd"))
    spec = resolve("Mine-v0")
    assert spec.name == "Mine-v0"
    assert spec.env == CartPole()
    assert isinstance(spec.make_host(), OnHost)
    assert spec.features.names == tuple("abcd")
    assert spec.actions.names == ("push left", "push right")
    assert resolve("Mine-v0", feature_names=list("wxyz")).features.names == tuple("wxyz")

    register("Blackjack-v1", action_names=["stick", "hit"])
    assert resolve("Blackjack-v1").actions.names == ("stick", "hit")
    register("Home-v0", Homemade, feature_names=["l", "r"])
    assert resolve("Home-v0").features.names == ("l", "r")
    assert resolve("Home-v0").host_envs(2).reset(seed=0).shape == (2, 2)


def test_names_of_the_wrong_number() -> None:
    with pytest.raises(ValueError, match="feature_names must have 4 names, got 1"):
        resolve("CartPole-v1", feature_names=["a"])
    with pytest.raises(ValueError, match="feature_names must have 4 names, got 0"):
        resolve("CartPole-v1", feature_names=[])
    with pytest.raises(ValueError, match="action_names must have 2 names, got 3"):
        resolve("CartPole-v1", action_names=["a", "b", "c"])


def test_a_twin_is_found_without_making_gymnasiums() -> None:
    program = (
        "import sys; from sympol.envs.registry import resolve; resolve('CartPole-v1');"
        "print([m for m in sys.modules if 'classic_control.' in m or 'pygame' in m])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", sorted(NAMES))
def test_gymnasium_s_own_environments_have_names(name):
    spec = resolve(name)
    assert (spec.features.names, spec.actions.names, spec.features.integers) == NAMES[name]


def test_names_that_no_longer_fit_are_left_out():
    lake = resolve("FrozenLake-v1", env_kwargs={"map_name": "8x8"})
    assert (lake.features.names[0], lake.actions.names[0]) == ("x = 0", "left")
    lander = resolve("LunarLander-v3", env_kwargs={"continuous": True})
    assert (lander.features.names[1], lander.actions.names) == ("height", ("action[0]", "action[1]"))


def test_a_wrapped_environment_has_no_names_but_its_own():
    wrapped = gymnasium.wrappers.RescaleObservation(gymnasium.make("LunarLander-v3"), -1, 1)
    assert resolve(wrapped).features.names[0] == "x[0]"


def test_arguments_of_an_environment_with_a_twin_in_jax_make_it_in_gymnasium():
    spec = resolve("Pendulum-v1", env_kwargs={"g": 5.0})
    assert spec.env is None
    assert spec.make_host().unwrapped.g == 5.0
    with pytest.raises(ValueError, match="not written in JAX"):
        resolve("Pendulum-v1", env_kwargs={"g": 5.0}, backend="jax")


def test_what_an_object_was_made_with_is_known():
    assert resolve(gymnasium.make("Pendulum-v1", g=5.0)).env_kwargs == {"g": 5.0}
    assert resolve(gymnasium.make("LunarLanderContinuous-v3", render_mode="rgb_array")).env_kwargs == {}


@pytest.mark.parametrize(
    ("env", "message"), [("LunarLander-v3", "wings"), (CartPole(), "by id or by a function")]
)
def test_arguments_that_do_not_fit_are_an_error(env, message):
    with pytest.raises(ValueError, match=message):
        resolve(env, env_kwargs={"wings": 2})
