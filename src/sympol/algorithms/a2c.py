"""Advantage actor-critic (Mnih et al., 2016), synchronous: one step of the optimiser for each rollout."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

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
    """Update the networks once on the first ``2^stage`` chunks of the rollout, all of them one batch.

    ``next_x`` is the scaled observation after the last step, from which the rollout's end is bootstrapped. Nothing is
    drawn: ``key`` is there because every algorithm is given one.
    """
    num_chunks = jnp.int32(1) << stage
    samples = make_batch(config, distribution, hyper, state.networks, rollout, next_x, num_chunks)
    ent_coef, rate = coefficients(config, hyper, state)

    def add(i: Int[Array, ""], total: Any) -> Any:
        rows = i * config.chunk_size
        chunk = jax.tree.map(lambda a: jax.lax.dynamic_slice_in_dim(a, rows, config.chunk_size), samples)
        gradient = jax.grad(a2c_loss, has_aux=True)(state.networks, distribution, hyper, ent_coef, chunk)
        return jax.tree.map(jnp.add, total, gradient)

    zeros = (jax.tree.map(jnp.zeros_like, state.networks), Losses.zeros())
    gradient, losses = divide(jax.lax.fori_loop(0, num_chunks, add, zeros), num_chunks)
    networks, opt_state = apply_gradients_but(
        held(config, state), state.networks, gradient, state.opt_state, hyper, rate
    )
    return state._replace(networks=networks, opt_state=opt_state, losses=losses)


def a2c_loss(
    networks: Networks,
    distribution: Distribution,
    hyper: Hyperparameters,
    ent_coef: Float[Array, ""],
    batch: Batch,
) -> tuple[Float[Array, ""], Losses]:
    """Policy gradient, squared error of the value, entropy bonus; means over the batch."""
    outputs, log_std = networks.actor(batch.x), networks.actor.log_std
    log_prob = distribution.log_prob(outputs, log_std, batch.action)
    policy_loss = -jnp.mean(log_prob * batch.advantage)
    value_loss = 0.5 * jnp.mean((networks.critic(batch.x)[:, 0] - batch.value_target) ** 2)
    entropy = jnp.mean(distribution.entropy(outputs, log_std))
    loss = policy_loss + hyper.vf_coef * value_loss - ent_coef * entropy
    nothing = jnp.float32(0)  # the policy that acted is the one that learns: no ratio to clip
    return loss, Losses(policy_loss, value_loss, entropy, nothing, nothing)
