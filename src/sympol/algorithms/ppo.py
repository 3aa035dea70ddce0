"""Proximal policy optimization (Schulman et al., 2017)."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..functional.shuffle import Shuffle
from ..policies.distributions import Distribution
from ..policies.tree import FixedSplits
from .algorithm import Experience, Metrics, mean_of, zeros_of
from .config import Hyperparameters
from .on_policy import Batch, OnPolicy, coefficients, make_batch
from .optim import Networks, apply_gradients, frozen
from .state import TrainState


class PPO(OnPolicy):
    """Several epochs of minibatch steps on the clipped surrogate of each rollout."""

    def update(
        self, hyper: Hyperparameters, state: TrainState, experience: Experience, key: PRNGKeyArray
    ) -> tuple[TrainState, Metrics]:
        """Take ``num_epochs`` passes over the rollout; see `Algorithm.update`."""
        config, distribution, stage = self.config, self.distribution, experience.stage
        samples, state = make_batch(config, distribution, hyper, state, experience)
        state = self.grown(state, samples, experience.stage)
        ent_coef, rate = coefficients(config, hyper, state)
        mask = frozen(config, state)

        grown: Any = state.networks.actor
        splits = grown.rollout() if config.grow_splits else None

        def loss(networks: Networks, batch: Batch) -> tuple[Float[Array, ""], Metrics]:
            if splits is not None:  # they stay, so nothing is to be differentiated but the leaves
                leaves: Any = networks.actor
                actor = FixedSplits(splits._replace(leaf_values=leaves.leaf_values), leaves.log_std)
                networks = networks._replace(actor=actor)
            return ppo_loss(networks, distribution, hyper, ent_coef, batch)

        # Accumulating micro-batches of one fixed shape makes any batch out of one compiled gradient.
        micro_size = config.chunk_size // config.num_minibatches
        num_micro = config.num_minibatches << stage
        accumulate = (1 << stage) if config.dynamic_batch else jnp.int32(1)

        def epoch(i: Int[Array, ""], carry: Any) -> Any:
            shuffle = Shuffle.create(jax.random.fold_in(key, i), config.chunk_size, 1 << config.max_stage)

            def gradient_of(micro: Int[Array, ""], networks: Networks) -> tuple[Networks, Metrics]:
                rows = shuffle(micro * micro_size + jnp.arange(micro_size), stage)
                batch = jax.tree.map(lambda a: a[rows], samples)
                return jax.grad(loss, has_aux=True)(networks, batch)

            def step(j: Int[Array, ""], carry: Any) -> Any:
                networks, opt_state, metrics = carry

                def add(k: Int[Array, ""], total: Any) -> Any:
                    return jax.tree.map(jnp.add, total, gradient_of(j * accumulate + k, networks))

                zeros = jax.tree.map(jnp.zeros_like, (networks, metrics))
                gradient, aux = mean_of(jax.lax.fori_loop(0, accumulate, add, zeros), accumulate)
                networks, opt_state = apply_gradients(networks, gradient, opt_state, hyper, rate, mask)
                return networks, opt_state, jax.tree.map(jnp.add, metrics, aux)

            return jax.lax.fori_loop(0, num_micro // accumulate, step, carry)

        _, metrics = jax.eval_shape(loss, state.networks, samples)
        carry = (state.networks, state.opt_state, zeros_of(metrics))
        networks, opt_state, metrics = jax.lax.fori_loop(0, config.num_epochs, epoch, carry)
        metrics = mean_of(metrics, config.num_epochs * (num_micro // accumulate))
        return state._replace(networks=networks, opt_state=opt_state), metrics


def ppo_loss(
    networks: Networks,
    distribution: Distribution,
    hyper: Hyperparameters,
    ent_coef: Float[Array, ""],
    batch: Batch,
) -> tuple[Float[Array, ""], Metrics]:
    """Compute the clipped surrogate loss of a batch (equations 7 and 9 of the paper).

    Args:
        networks: The actor and the critic.
        distribution: The distribution that the actor parametrizes.
        hyper: The traced hyperparameters.
        ent_coef: The weight of the entropy bonus now.
        batch: Samples ``[batch, ...]``.

    Returns:
        The loss, a mean over the batch, and its parts as metrics.
    """
    outputs, log_std = networks.actor(batch.x), networks.actor.log_std
    log_ratio = distribution.log_prob(outputs, log_std, batch.action) - batch.log_prob
    ratio = jnp.exp(log_ratio)
    clipped = jnp.clip(ratio, 1 - hyper.clip_eps, 1 + hyper.clip_eps)
    policy_loss = -jnp.mean(jnp.minimum(ratio * batch.advantage, clipped * batch.advantage))
    value_loss = 0.5 * jnp.mean((networks.critic(batch.x)[:, 0] - batch.value_target) ** 2)
    entropy = jnp.mean(distribution.entropy(outputs, log_std))
    loss = policy_loss + hyper.vf_coef * value_loss - ent_coef * entropy
    return loss, {
        "train/policy_gradient_loss": policy_loss,
        "train/value_loss": value_loss,
        "train/entropy": entropy,
        "train/approx_kl": jnp.mean(ratio - 1 - log_ratio),
        "train/clip_fraction": jnp.mean((jnp.abs(ratio - 1) > hyper.clip_eps).astype(jnp.float32)),
    }
