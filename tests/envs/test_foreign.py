"""Environments in JAX of other libraries: flattened, cast, cut at their time limit, found by object and id."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.experimental.functional import FuncEnv
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from packaging.requirements import Requirement

import sympol
from sympol.envs.adapters import ADAPTERS, load
from sympol.envs.errors import MissingExtra
from sympol.envs.foreign import Answer, ForeignEnv, Library, flat, space_like
from sympol.envs.libraries import ADAPTER_OF, is_library_id
from sympol.envs.on_host import OnHost
from sympol.envs.spaces import Features

ROOT = Path(__file__).parents[2]

NESTED = Dict(
    {
        "board": MultiBinary((2, 2)),
        "code": MultiDiscrete([3, 2], start=[1, 0]),
        "mode": Discrete(3, start=5),
        "pair": Tuple((Box(-1, 1, (), np.float32), Box(0, 9, (2,), np.int32))),
    }
)


class Seen(NamedTuple):
    pair: Any
    board: Any
    mode: Any
    code: Any


class Line(FuncEnv):
    """Walk to the end of a line of five cells; the state keeps a key, the reward is an integer."""

    observation_space = Dict({"at": Discrete(6), "time": Box(0, 99, (), np.int32)})
    action_space = Discrete(2, start=1)

    def __init__(self, max_episode_steps: int | None = None) -> None:
        super().__init__()
        self.max_episode_steps = max_episode_steps

    def initial(self, rng: Any, params: Any = None) -> Any:
        return {"at": jax.random.randint(rng, (), 0, 2), "time": jnp.int32(0), "key": rng}

    def transition(self, state: Any, action: Any, rng: Any, params: Any = None) -> Any:
        at = jnp.clip(state["at"] + 2 * action - 3, 0, 5)
        return {"at": at, "time": state["time"] + 1, "key": jax.random.split(state["key"])[0]}

    def observation(self, state: Any, rng: Any, params: Any = None) -> Any:
        return {"time": state["time"], "at": state["at"]}

    def reward(self, state: Any, action: Any, next_state: Any, rng: Any, params: Any = None) -> Any:
        return next_state["at"] == 5

    def terminal(self, state: Any, rng: Any, params: Any = None) -> Any:
        return state["at"] == 5


def test_observations_become_the_features_that_gymnasium_s_space_has() -> None:
    observation = NESTED.sample()
    features = Features.of(NESTED)
    expected = features.flatten(observation)
    np.testing.assert_array_equal(jax.jit(lambda o: flat(NESTED, o))(observation), expected)
    np.testing.assert_array_equal(flat(NESTED, Seen(**observation)), expected)


def test_a_space_is_read_off_shapes_where_a_library_has_none() -> None:
    @dataclasses.dataclass
    class Parts:
        a: Any
        b: Any

    def shape(dims: tuple[int, ...], dtype: Any) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(dims, dtype)

    space = space_like(Parts(shape((2,), np.float32), (shape((3,), bool), shape((), np.int32))))
    assert Features.of(space).names == ("a[0]", "a[1]", "b.0[0]", "b.0[1]", "b.0[2]", "b.1")
    assert Features.of(space).integers == (2, 3, 4, 5)


def test_a_functional_environment_of_gymnasium_s() -> None:
    spec = sympol.resolve(Line())
    assert (spec.name, spec.backend, spec.max_episode_steps) == ("Line", "jax", None)
    assert spec.features.names == (*(f"at = {i}" for i in range(6)), "time")
    assert [group.features for group in spec.features.groups] == [tuple(range(6))]
    assert spec.features.integers == (6,)
    assert isinstance(spec.make_host(), OnHost)
    assert "an environment in JAX of class" in spec.origin.not_kept

    env = spec.env
    assert env is not None
    state, observation = env.reset(jax.random.key(1))
    lengths = 0
    while True:
        state, step = env.step(jax.random.key(2), state, jnp.int32(1))
        lengths += 1
        if step.terminated:
            break
        assert step.reward == 0
    assert lengths == 5 - int(np.argmax(observation))
    assert (step.reward, step.truncated) == (1, False)
    assert step.reward.dtype == jnp.float32


def test_a_time_limit_truncates() -> None:
    env = sympol.resolve(Line(max_episode_steps=3)).env
    assert env is not None
    state, _ = env.reset(jax.random.key(0))
    ends = []
    for _ in range(3):
        state, step = env.step(jax.random.key(0), state, jnp.int32(0))
        ends.append((bool(step.terminated), bool(step.truncated)))
    assert ends == [(False, False), (False, False), (False, True)]


def test_it_is_trained_and_evaluated() -> None:
    agent = sympol.PPO(
        "tree", Line(max_episode_steps=20), total_timesteps=4096, num_envs=8, num_evals=1, seed=0
    )
    agent.learn(progress_bar=False)
    mean, _ = sympol.evaluate_policy(agent.tree(), Line(max_episode_steps=20), 5)
    assert 0 <= mean <= 1


@pytest.mark.parametrize("library", ADAPTER_OF)
def test_what_is_missing_is_named_with_the_extra_that_installs_it(library: str) -> None:
    adapter = load(ADAPTERS[f"{library}:"])
    assert isinstance(adapter, Library)
    assert is_library_id(f"{library}:Some-v0")
    try:
        __import__(adapter.package)
    except ModuleNotFoundError:
        with pytest.raises(MissingExtra, match=rf"pip install 'sympol\[{library}\]'"):
            sympol.resolve(f"{library}:Some-v0")
    else:
        with pytest.raises(ValueError, match=f"unknown environment '{library}:Some-v0'"):
            sympol.resolve(f"{library}:Some-v0")


def test_box2d_is_installable_beside_gymnax_1_which_refuses_gymnasium_1_4() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    gymnasium_of_box2d = next(one for one in map(Requirement, extras["box2d"]) if one.name == "gymnasium")
    assert gymnasium_of_box2d.specifier.contains("1.3.0")
    assert {*ADAPTER_OF} <= {*extras}


def test_objects_are_recognised_by_the_module_of_a_class_they_inherit_from() -> None:
    theirs = type("Base", (), {"__module__": "tiny.envs"})
    mine = type("Mine", (theirs,), {})

    class Tiny(Library):
        prefix = package = "tiny"

        def names(self) -> list[str]:
            return []

        def make(self, name: str, **kwargs: Any) -> ForeignEnv:
            raise NotImplementedError

        def wrap(self, env: Any) -> ForeignEnv:
            return Counting()

    class Counting(ForeignEnv):
        def __init__(self) -> None:
            super().__init__("tiny:counting", Box(0, 1, (1,), np.float32), Discrete(2), None)

        def begin(self, key: Any) -> tuple[Any, Any]:
            return (), jnp.zeros(1)

        def advance(self, key: Any, state: Any, action: Any) -> Answer:
            return Answer((), jnp.zeros(1), 0, False)

    assert isinstance(Tiny().adopt(mine()), Counting)
    assert isinstance(Tiny().adopt((mine(), "params")), Counting)
    assert Tiny().adopt(gymnasium.make("CartPole-v1")) is None
    assert Tiny().adopt(()) is None
