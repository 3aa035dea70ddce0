"""Proximal policy optimisation (Schulman et al., 2017): from a rollout to better networks."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..functional.shuffle import Shuffle
from ..policies.distributions import Distribution
from ..types import Transition
from .batch import Batch, coefficients, divide, make_batch
from .config import Config, Hyperparameters
from .freezing import apply_gradients_but, held
from .optimizer import Networks
from .state import Losses, TrainState


def learn(
    config: Config,
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
    samples = make_batch(config, distribution, hyper, state.networks, rollout, next_x, 1 << stage)
    ent_coef, rate = coefficients(config, hyper, state)
    still = held(config, state)

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
            gradient, aux = divide(total, accumulate)
            networks, opt_state = apply_gradients_but(still, networks, gradient, opt_state, hyper, rate)
            return networks, opt_state, jax.tree.map(jnp.add, losses, aux)

        return jax.lax.fori_loop(0, num_micro // accumulate, update, carry)

    carry = (state.networks, state.opt_state, Losses.zeros())
    networks, opt_state, losses = jax.lax.fori_loop(0, config.num_epochs, epoch, carry)
    losses = divide(losses, config.num_epochs * (num_micro // accumulate))
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
