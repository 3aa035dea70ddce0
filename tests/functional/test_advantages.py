"""GAE against the sum it abbreviates."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from sympol.functional.advantages import fold_bootstrap, gae


class Case(NamedTuple):
    reward: np.ndarray
    value: np.ndarray
    done: np.ndarray
    next_value: np.ndarray


def random_case(seed: int, num_steps: int = 23, num_envs: int = 5, p_done: float = 0.15) -> Case:
    rng = np.random.default_rng(seed)
    shape = (num_steps, num_envs)
    reward, value = (rng.normal(size=shape).astype(np.float32) for _ in range(2))
    return Case(reward, value, rng.random(shape) < p_done, rng.normal(size=num_envs).astype(np.float32))


def closed_form(case: Case, gamma: float, gae_lambda: float) -> np.ndarray:
    """A_t = Σ_l (γλ)^l δ_{t+l}, up to the end of the episode or of the rollout; δ by its definition."""
    num_steps, num_envs = case.reward.shape
    advantage = np.zeros((num_steps, num_envs))
    for e in range(num_envs):
        for t in range(num_steps):
            for step in range(t, num_steps):
                after = case.value[step + 1, e] if step + 1 < num_steps else case.next_value[e]
                after = 0.0 if case.done[step, e] else float(after)
                delta = float(case.reward[step, e]) + gamma * after - float(case.value[step, e])
                advantage[t, e] += (gamma * gae_lambda) ** (step - t) * delta
                if case.done[step, e]:
                    break
    return advantage


def run(case: Case, gamma: float, gae_lambda: float, next_advantage: np.ndarray | None = None) -> np.ndarray:
    zeros = np.zeros_like(case.next_value)
    after = zeros if next_advantage is None else next_advantage
    arrays = (jnp.asarray(a) for a in (*case, after))
    return np.asarray(gae(*arrays, gamma=gamma, gae_lambda=gae_lambda))


@pytest.mark.parametrize(("gamma", "gae_lambda"), [(0.99, 0.95), (1, 1), (0.9, 0), (0, 0.5), (0.5, 1)])
@pytest.mark.parametrize("p_done", [0, 0.15, 1])
def test_equals_the_closed_form(gamma, gae_lambda, p_done):
    case = random_case(1, p_done=p_done)
    np.testing.assert_allclose(
        run(case, gamma, gae_lambda), closed_form(case, gamma, gae_lambda), rtol=2e-5, atol=2e-5
    )


@pytest.mark.parametrize("cut", [1, 7, 22])
def test_in_pieces_it_is_the_same_to_the_bit(cut):
    case = random_case(2)
    whole = run(case, 0.97, 0.9)
    late = Case(*(a[cut:] for a in case[:3]), case.next_value)
    late_advantage = run(late, 0.97, 0.9)
    early = Case(*(a[:cut] for a in case[:3]), case.value[cut])
    early_advantage = run(early, 0.97, 0.9, late_advantage[0])
    np.testing.assert_array_equal(np.concatenate([early_advantage, late_advantage]), whole)


def test_nothing_passes_over_the_end_of_an_episode():
    case = random_case(3, p_done=0)
    case.done[10] = True
    before = run(case, 0.99, 0.95)
    case.value[11:] += 100
    case.reward[11:] -= 100
    np.testing.assert_array_equal(run(case, 0.99, 0.95)[:11], before[:11])


def test_lambda_one_is_return_minus_value():
    case = random_case(4)
    gamma, to_go = 0.9, case.next_value.astype(float)
    for t in reversed(range(len(case.reward))):
        to_go = case.reward[t] + gamma * np.where(case.done[t], 0, to_go)
        np.testing.assert_allclose(run(case, gamma, 1.0)[t], to_go - case.value[t], rtol=1e-5, atol=1e-5)


def test_only_the_clock_bootstraps():
    reward, last_value = jnp.ones(4), jnp.full(4, 10.0)
    truncated = jnp.array([False, True, False, True])
    terminated = jnp.array([False, False, True, True])
    folded = fold_bootstrap(reward, truncated, terminated, last_value, 0.5)
    np.testing.assert_array_equal(folded, [1, 6, 1, 1])


def test_a_time_limit_is_worth_what_would_have_followed():
    """One step, cut by the clock: δ = r + γ·V(true last observation) − V, the next episode's value unseen."""
    true = jnp.ones((1, 1), bool)
    reward = fold_bootstrap(jnp.ones((1, 1)), true, ~true, jnp.full((1, 1), 3.0), 0.9)
    next_value = jnp.full(1, 1e6)  # belongs to the next episode
    advantage = gae(reward, jnp.full((1, 1), 2.0), true, next_value, jnp.zeros(1), gamma=0.9, gae_lambda=0.8)
    np.testing.assert_allclose(advantage, [[1 + 0.9 * 3 - 2]], rtol=1e-6)
