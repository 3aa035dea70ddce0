"""Environments of other libraries, where those are installed: what they answer, and when their episodes end."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sympol
from sympol.envs.errors import UnknownEnvironment

LIBRARIES = {
    "gymnax:CartPole-v1": "gymnax",
    "gymnax:Breakout-MinAtar": "gymnax",
    "jumanji:Snake-v1": "jumanji",
    "jumanji:MultiCVRP-v0": "jumanji",
    "navix:Navix-DoorKey-5x5-v0": "navix",
    "pgx:2048": "pgx",
    "brax:inverted_pendulum": "brax",
    "playground:CartpoleBalance": "mujoco_playground",
    "craftax:Craftax-Classic-Symbolic-v1": "craftax",
    "phys2d/CartPole-v1": "flax",
}


def played(env_id: str, steps: int, **kwargs: Any) -> tuple[Any, Any, Any]:
    """Return the description, the observations ``[steps, envs, features]`` and the steps of four random episodes."""
    spec = sympol.resolve(env_id, env_kwargs=kwargs)
    env = spec.env
    assert env is not None
    space = env.action_space
    space.seed(0)
    actions = np.stack([np.stack([space.sample() for _ in range(4)]) for _ in range(steps)])
    actions = actions.astype(np.float32 if actions.dtype.kind == "f" else np.int32)
    state, _ = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), 4))

    def one_step(state: Any, action: Any) -> Any:
        return jax.vmap(env.step)(jax.random.split(jax.random.key(1), 4), state, action)

    _, results = jax.jit(lambda s, a: jax.lax.scan(one_step, s, a))(state, actions)
    ended = (results.terminated | results.truncated).astype(jnp.int32)
    return spec, jnp.cumsum(ended, 0) - ended == 0, results


@pytest.mark.slow
@pytest.mark.parametrize("env_id", LIBRARIES)
def test_observations_are_finite_and_within_their_bounds(env_id: str) -> None:
    pytest.importorskip(LIBRARIES[env_id])
    spec, alive, results = played(env_id, 30)
    seen = np.asarray(results.observation)[np.asarray(alive)]
    assert seen.dtype == np.float32
    assert seen.shape[1] == len(spec.features.names)
    assert np.isfinite(seen).all()
    assert ((seen >= spec.features.low) & (seen <= spec.features.high)).all()
    for group in spec.features.groups:
        assert (seen[:, list(group.features)].sum(axis=1) == 1).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env_id", "module"),
    [
        ("gymnax:Freeway-MinAtar", "gymnax"),
        ("gymnax:Pendulum-v1", "gymnax"),
        ("jumanji:SlidingTilePuzzle-v0", "jumanji"),
        ("navix:Navix-DoorKey-5x5-v0", "navix"),
        ("pgx:minatar-freeway", "pgx"),
    ],
)
def test_a_time_limit_truncates_and_does_not_terminate(env_id: str, module: str) -> None:
    pytest.importorskip(module)
    spec, _, results = played(env_id, 6, max_episode_steps=6)
    assert spec.max_episode_steps == 6
    assert not results.terminated.any()
    np.testing.assert_array_equal(results.truncated.all(1), [False] * 5 + [True])


def test_an_object_of_gymnax_is_known_by_its_name_and_parameters() -> None:
    gymnax = pytest.importorskip("gymnax")
    env, params = gymnax.make("CartPole-v1")
    spec = sympol.resolve(env)
    assert (spec.name, spec.origin.is_as_registered) == ("gymnax:CartPole-v1", True)
    changed = sympol.resolve((env, params.replace(gravity=5.0)))
    assert changed.env_kwargs == {"gravity": 5.0}
    assert sympol.resolve(changed.name, env_kwargs=changed.env_kwargs).env.params.gravity == 5


def test_a_game_for_two_and_a_wrong_name_are_refused() -> None:
    pytest.importorskip("pgx")
    with pytest.raises(ValueError, match="pgx:tic_tac_toe is a game of 2 players"):
        sympol.resolve("pgx:tic_tac_toe")
    with pytest.raises(UnknownEnvironment, match="'pgx:minatar-breakout'"):
        sympol.resolve("pgx:minatar-breakou")
