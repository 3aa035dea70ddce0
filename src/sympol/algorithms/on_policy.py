"""Functions that on-policy algorithms share: samples with advantages, and the schedules of coefficients."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from ..functional.advantages import fold_bootstrap, gae
from ..policies.distributions import Distribution
from ..types import Action, Transition
from .algorithm import Experience
from .config import Config, Hyperparameters
from .optim import Networks
from .state import TrainState


class Batch(NamedTuple):
    """Samples of one rollout, flat.

    Attributes:
        x: Scaled observations.
        action: The actions as they were sampled.
        log_prob: Their log-probabilities under the policy that collected them.
        advantage: Generalized advantage estimates.
        value_target: Advantages plus values, which the critic learns.
    """

    x: Float[Array, "batch features"]
    action: Action
    log_prob: Float[Array, " batch"]
    advantage: Float[Array, " batch"]
    value_target: Float[Array, " batch"]


def coefficients(
    config: Config, hyper: Hyperparameters, state: TrainState
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Compute the weight of the entropy bonus and the factor of all learning rates at this point of the training.

    Args:
        config: The configuration.
        hyper: The traced hyperparameters.
        state: The state of the training.

    Returns:
        The weight, and the factor for `apply_gradients`.
    """
    progress = state.timestep.astype(jnp.float32) / config.total_timesteps
    rate = _linear(progress, hyper.lr_end_factor) * state.validation.lr_factor
    return hyper.ent_coef * _linear(progress, hyper.ent_end_factor), rate


def _linear(progress: Float[Array, ""], end_factor: Float[Array, ""]) -> Float[Array, ""]:
    """Interpolate between 1 and ``end_factor`` as progress goes from 0 to 1."""
    return 1 + (end_factor - 1) * jnp.clip(progress, 0, 1)


def make_batch(
    config: Config,
    distribution: Distribution,
    hyper: Hyperparameters,
    networks: Networks,
    experience: Experience,
) -> Batch:
    """Compute values, log-probabilities and advantages of a rollout, chunk by chunk from its end.

    Args:
        config: The configuration.
        distribution: The distribution that the actor parametrizes.
        hyper: The traced hyperparameters.
        networks: The networks that collected the rollout.
        experience: The rollout.

    Returns:
        One row for each sample of the buffer; rows beyond the valid chunks mean nothing.
    """
    rollout, next_x, num_chunks = experience.rollout, experience.next_x, experience.num_chunks
    max_chunks, chunk_steps, num_envs = rollout.reward.shape
    policy, log_std = networks.actor.rollout(), networks.actor.log_std

    def value_of(x: Float[Array, "*batch features"]) -> Float[Array, "*batch"]:
        return networks.critic(x.reshape(-1, x.shape[-1]))[:, 0].reshape(x.shape[:-1])

    def one_chunk(i: Int[Array, ""], carry: Any) -> Any:
        (next_value, next_advantage, moments), buffers = carry
        index = num_chunks - 1 - i
        chunk: Transition = jax.tree.map(lambda a: a[index], rollout)
        value = value_of(chunk.observation)
        cut = chunk.truncated & ~chunk.terminated
        last_value = jax.lax.cond(
            jnp.any(cut), value_of, lambda x: jnp.zeros(x.shape[:-1]), chunk.last_observation
        )
        reward = fold_bootstrap(
            hyper.reward_scale * chunk.reward, chunk.truncated, chunk.terminated, last_value, hyper.gamma
        )
        advantage = gae(
            reward,
            value,
            chunk.terminated | chunk.truncated,
            next_value,
            next_advantage,
            gamma=hyper.gamma,
            gae_lambda=hyper.gae_lambda,
        )
        x = chunk.observation.reshape(-1, chunk.observation.shape[-1])
        action = chunk.action.reshape(-1, *chunk.action.shape[2:])
        log_prob = distribution.log_prob(policy(x), log_std, action).reshape(chunk_steps, num_envs)
        rows = (log_prob, advantage, advantage + value)
        buffers = jax.tree.map(
            lambda b, r: jax.lax.dynamic_update_index_in_dim(b, r, index, 0), buffers, rows
        )
        moments = (moments[0] + jnp.mean(advantage), moments[1] + jnp.mean(advantage**2))
        return (value[0], advantage[0], moments), buffers

    empty = tuple(jnp.zeros_like(rollout.reward) for _ in range(3))
    zero = jnp.float32(0)
    start = ((value_of(next_x), jnp.zeros(num_envs), (zero, zero)), empty)
    (_, _, moments), (log_prob, advantage, target) = jax.lax.fori_loop(0, num_chunks, one_chunk, start)
    if config.norm_adv:
        mean, square = (m / num_chunks.astype(jnp.float32) for m in moments)
        std = jnp.sqrt(jnp.maximum(square - mean**2, 0))
        advantage = (advantage - mean) / (std + 1e-8)

    def flat(a: Array) -> Array:
        return a.reshape(max_chunks * chunk_steps * num_envs, *a.shape[3:])

    return jax.tree.map(flat, Batch(rollout.observation, rollout.action, log_prob, advantage, target))
