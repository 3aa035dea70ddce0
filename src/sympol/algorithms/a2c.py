"""Advantage actor-critic, synchronous (Mnih et al., 2016)."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..policies.distributions import Distribution
from .algorithm import Experience, Metrics, mean_of, zeros_of
from .config import Hyperparameters
from .on_policy import Batch, OnPolicy, coefficients, make_batch
from .optim import Networks, apply_gradients, frozen
from .state import TrainState


class A2C(OnPolicy):
    """One optimizer step for each rollout, on all of its samples."""

    def update(
        self, hyper: Hyperparameters, state: TrainState, experience: Experience, key: PRNGKeyArray
    ) -> tuple[TrainState, Metrics]:
        """Take one step, accumulating the gradient chunk by chunk; see `Algorithm.update`."""
        config, num_chunks = self.config, experience.num_chunks
        samples, state = make_batch(config, self.distribution, hyper, state, experience)
        state = self.grown(state, samples, experience.stage)
        networks = state.networks
        ent_coef, rate = coefficients(config, hyper, state)

        def gradient_of(chunk: Int[Array, ""]) -> tuple[Networks, Metrics]:
            rows = chunk * config.chunk_size
            batch = jax.tree.map(lambda a: jax.lax.dynamic_slice_in_dim(a, rows, config.chunk_size), samples)
            return jax.grad(a2c_loss, has_aux=True)(networks, self.distribution, hyper, ent_coef, batch)

        def add(chunk: Int[Array, ""], total: Any) -> Any:
            return jax.tree.map(jnp.add, total, gradient_of(chunk))

        zeros = zeros_of(jax.eval_shape(gradient_of, jnp.int32(0)))
        gradient, metrics = mean_of(jax.lax.fori_loop(0, num_chunks, add, zeros), num_chunks)
        networks, opt_state = apply_gradients(
            networks, gradient, state.opt_state, hyper, rate, frozen(config, state)
        )
        return state._replace(networks=networks, opt_state=opt_state), metrics


def a2c_loss(
    networks: Networks,
    distribution: Distribution,
    hyper: Hyperparameters,
    ent_coef: Float[Array, ""],
    batch: Batch,
) -> tuple[Float[Array, ""], Metrics]:
    """Compute the policy gradient loss of a batch; arguments and result are those of `ppo.ppo_loss`.

    The policy that acted is the one that learns, so there is no ratio to clip.
    """
    outputs, log_std = networks.actor(batch.x), networks.actor.log_std
    log_prob = distribution.log_prob(outputs, log_std, batch.action)
    policy_loss = -jnp.mean(log_prob * batch.advantage)
    value_loss = 0.5 * jnp.mean((networks.critic(batch.x)[:, 0] - batch.value_target) ** 2)
    entropy = jnp.mean(distribution.entropy(outputs, log_std))
    loss = policy_loss + hyper.vf_coef * value_loss - ent_coef * entropy
    return loss, {
        "train/policy_gradient_loss": policy_loss,
        "train/value_loss": value_loss,
        "train/entropy": entropy,
    }
