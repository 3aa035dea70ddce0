"""Proximal policy optimisation (Schulman et al., 2017): from a rollout to better networks."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..functional.advantages import fold_bootstrap, gae
from ..functional.schedules import Shuffle
from ..policies.distributions import Distribution
from ..types import Action, Transition
from .config import Hyperparameters, PPOConfig
from .optimizer import Networks, apply_gradients
from .state import Losses, TrainState


class Batch(NamedTuple):
    """What the loss needs of each sample."""

    x: Float[Array, "batch features"]
    action: Action
    log_prob: Float[Array, " batch"]
    advantage: Float[Array, " batch"]
    value_target: Float[Array, " batch"]


def learn(
    config: PPOConfig,
    distribution: Distribution,
    hyper: Hyperparameters,
    state: TrainState,
    rollout: Transition,
    next_x: Float[Array, "envs features"],
    stage: Int[Array, ""],
    key: PRNGKeyArray,
) -> TrainState:
    """Update the networks on the first ``2^stage`` chunks of the rollout.

    ``next_x`` is the scaled observation after the last step, from which the rollout's end is bootstrapped.
    """
    samples = _advantages(config, distribution, hyper, state.networks, rollout, next_x, 1 << stage)
    progress = state.timestep.astype(jnp.float32) / config.total_timesteps
    ent_coef = hyper.ent_coef * _linear(progress, hyper.ent_end_factor)
    rate = _linear(progress, hyper.lr_end_factor) * state.validation.lr_factor

    # Accumulating micro-batches of one fixed shape makes any batch out of one compiled gradient.
    micro_size = config.chunk_size // config.num_minibatches
    num_micro = config.num_minibatches << stage
    accumulate = (1 << stage) if config.dynamic_batch else jnp.int32(1)

    def epoch(i: Int[Array, ""], carry: Any) -> Any:
        shuffle = Shuffle.create(jax.random.fold_in(key, i), config.chunk_size, 1 << config.max_stage)

        def gradient_of(micro: Int[Array, ""], networks: Networks) -> tuple[Networks, Losses]:
            rows = shuffle(micro * micro_size + jnp.arange(micro_size), stage)
            batch = jax.tree.map(lambda a: a[rows], samples)
            return jax.grad(ppo_loss, has_aux=True)(networks, distribution, hyper, ent_coef, batch)

        def update(j: Int[Array, ""], carry: Any) -> Any:
            networks, opt_state, losses = carry

            def add(k: Int[Array, ""], total: Any) -> Any:
                return jax.tree.map(jnp.add, total, gradient_of(j * accumulate + k, networks))

            zeros = (jax.tree.map(jnp.zeros_like, networks), Losses.zeros())
            total = jax.lax.fori_loop(0, accumulate, add, zeros)
            gradient, aux = _divide(total, accumulate)
            networks, opt_state = apply_gradients(networks, gradient, opt_state, hyper, rate)
            return networks, opt_state, jax.tree.map(jnp.add, losses, aux)

        return jax.lax.fori_loop(0, num_micro // accumulate, update, carry)

    carry = (state.networks, state.opt_state, Losses.zeros())
    networks, opt_state, losses = jax.lax.fori_loop(0, config.num_epochs, epoch, carry)
    losses = _divide(losses, config.num_epochs * (num_micro // accumulate))
    return state._replace(networks=networks, opt_state=opt_state, losses=losses)


def ppo_loss(
    networks: Networks,
    distribution: Distribution,
    hyper: Hyperparameters,
    ent_coef: Float[Array, ""],
    batch: Batch,
) -> tuple[Float[Array, ""], Losses]:
    """Clipped surrogate, squared error of the value, entropy bonus; means over the batch."""
    outputs, log_std = networks.actor(batch.x), networks.actor.log_std
    log_ratio = distribution.log_prob(outputs, log_std, batch.action) - batch.log_prob
    ratio = jnp.exp(log_ratio)
    clipped = jnp.clip(ratio, 1 - hyper.clip_eps, 1 + hyper.clip_eps)
    policy_loss = -jnp.mean(jnp.minimum(ratio * batch.advantage, clipped * batch.advantage))
    value_loss = 0.5 * jnp.mean((networks.critic(batch.x)[:, 0] - batch.value_target) ** 2)
    entropy = jnp.mean(distribution.entropy(outputs, log_std))
    loss = policy_loss + hyper.vf_coef * value_loss - ent_coef * entropy
    clip_fraction = jnp.mean((jnp.abs(ratio - 1) > hyper.clip_eps).astype(jnp.float32))
    approx_kl = jnp.mean(ratio - 1 - log_ratio)
    return loss, Losses(policy_loss, value_loss, entropy, approx_kl, clip_fraction)


def _divide(total: Any, count: Int[Array, ""]) -> Any:
    """Sums to means."""
    return jax.tree.map(lambda a: a / count.astype(jnp.float32), total)


def _linear(progress: Float[Array, ""], end_factor: Float[Array, ""]) -> Float[Array, ""]:
    """From 1 to ``end_factor`` as progress goes from 0 to 1."""
    return 1 + (end_factor - 1) * jnp.clip(progress, 0, 1)


def _advantages(
    config: PPOConfig,
    distribution: Distribution,
    hyper: Hyperparameters,
    networks: Networks,
    rollout: Transition,
    next_x: Float[Array, "envs features"],
    num_chunks: Int[Array, ""],
) -> Batch:
    """Values, log-probabilities and advantages of the whole rollout, chunk by chunk from its end.

    Rows beyond ``num_chunks`` chunks hold nothing of use.
    """
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
