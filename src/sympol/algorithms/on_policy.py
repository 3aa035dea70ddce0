"""The parts that on-policy algorithms share: samples with advantages, scales of returns, schedules of coefficients."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from ..functional.advantages import fold_bootstrap, gae
from ..policies.distributions import Distribution
from ..types import Action, Transition
from .algorithm import Algorithm, Experience
from .config import Config, Hyperparameters
from .evidence import Evidence
from .optim import Networks
from .return_scale import ReturnScale, rescale_critic
from .split_growth import grow, output_gradients
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
    if state.guide is None:
        progress = state.timestep.astype(jnp.float32) / config.total_timesteps
    else:
        begun = state.guide.steps
        own = jnp.maximum(config.total_timesteps - begun, 1)
        progress = (state.timestep - begun).astype(jnp.float32) / own.astype(jnp.float32)
    rate = _linear(progress, hyper.lr_end_factor) * state.validation.lr_factor
    return hyper.ent_coef * _linear(progress, hyper.ent_end_factor), rate


def _linear(progress: Float[Array, ""], end_factor: Float[Array, ""]) -> Float[Array, ""]:
    """Interpolate between 1 and ``end_factor`` as progress goes from 0 to 1."""
    return 1 + (end_factor - 1) * jnp.clip(progress, 0, 1)


class Memory(NamedTuple):
    """Everything that is kept beside the networks.

    Attributes:
        returns: The scale of the critic, if returns are normalized.
        evidence: Samples of the last rollouts, if splits grow out of several.
    """

    returns: ReturnScale | None
    evidence: Evidence | None


class OnPolicy(Algorithm):
    """An algorithm that learns from each rollout once, with a critic of state values."""

    def init_memory(self, networks: Networks) -> Memory:
        """Return what is kept before the first rollout."""
        returns = ReturnScale.zeros() if self.config.normalize_returns else None
        return Memory(returns, Evidence.zeros(self.config, self.num_features, self.distribution.num_outputs))

    def grown(self, state: TrainState, batch: Batch, stage: Int[Array, ""]) -> TrainState:
        """Return the state after its tree has grown (`split_growth`), if it does.

        Args:
            state: The state of the training.
            batch: The samples of the rollout.
            stage: How often the rollout has doubled.

        Returns:
            The state, with another actor that acts as the one before.
        """
        actor: Any = state.networks.actor
        if not self.config.grow_splits:
            return state
        gradients = output_gradients(self.distribution, actor, batch.x, batch.action, batch.advantage)
        limit = self.config.max_nodes or 2 ** (self.config.depth + 1)
        memory, most_leaves = state.memory, (limit + 1) // 2
        if memory.evidence is None:
            actor = grow(actor, batch.x, gradients, self.config.chunk_size << stage, most_leaves)
        else:
            evidence = memory.evidence.with_rollout(batch.x, gradients)
            memory = memory._replace(evidence=evidence)
            actor = jax.lax.cond(
                evidence.is_new(batch.x.shape[0]),
                lambda: grow(actor, evidence.x, evidence.gradients, evidence.x.shape[0], most_leaves),
                lambda: actor,
            )
        return state._replace(networks=state.networks._replace(actor=actor), memory=memory)


def make_batch(
    config: Config,
    distribution: Distribution,
    hyper: Hyperparameters,
    state: TrainState,
    experience: Experience,
) -> tuple[Batch, TrainState]:
    """Compute values, log-probabilities and advantages of a rollout, chunk by chunk from its end.

    Args:
        config: The configuration.
        distribution: The distribution that the actor parametrizes.
        hyper: The traced hyperparameters.
        state: The state of the training, with the networks that collected the rollout.
        experience: The rollout.

    Returns:
        One row for each sample of the buffer, where rows beyond the valid chunks mean nothing; and the state to learn
        from them, whose critic has the scale of the value targets.
    """
    networks, returns = state.networks, state.memory.returns if config.normalize_returns else None
    rollout, next_x, num_chunks = experience.rollout, experience.next_x, experience.num_chunks
    max_chunks, chunk_steps, num_envs = rollout.reward.shape
    policy, log_std = networks.actor.rollout(), networks.actor.log_std

    def value_of(x: Float[Array, "*batch features"]) -> Float[Array, "*batch"]:
        output = networks.critic(x.reshape(-1, x.shape[-1]))[:, 0].reshape(x.shape[:-1])
        return output if returns is None else returns.to_value(output)

    def one_chunk(i: Int[Array, ""], carry: Any) -> Any:
        (next_value, next_advantage, moments, sums), buffers = carry
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
        moments = _add_moments(moments, advantage)
        if returns is not None:
            largest = jnp.max(jnp.abs(hyper.reward_scale * chunk.reward))
            sums = (*_add_moments(sums[:2], advantage + value), jnp.maximum(sums[2], largest))
        return (value[0], advantage[0], moments, sums), buffers

    empty = tuple(jnp.zeros_like(rollout.reward) for _ in range(3))
    zero = jnp.float32(0)
    begin = (
        value_of(next_x),
        jnp.zeros(num_envs),
        (zero, zero),
        () if returns is None else (zero, zero, zero),
    )
    (*_, moments, sums), (log_prob, advantage, target) = jax.lax.fori_loop(
        0, num_chunks, one_chunk, (begin, empty)
    )
    count = num_chunks.astype(jnp.float32)
    if returns is not None:
        moved = returns.after(sums[0] / count, sums[1] / count, sums[2])
        critic = rescale_critic(networks.critic, returns, moved)
        memory = state.memory._replace(returns=moved)
        state = state._replace(networks=networks._replace(critic=critic), memory=memory)
        target = moved.to_output(target)
    if config.norm_adv:
        mean, square = (m / count for m in moments)
        std = jnp.sqrt(jnp.maximum(square - mean**2, 0))
        advantage = (advantage - mean) / (std + 1e-8)

    def flat(a: Array) -> Array:
        return a.reshape(max_chunks * chunk_steps * num_envs, *a.shape[3:])

    batch = Batch(rollout.observation, rollout.action, log_prob, advantage, target)
    return jax.tree.map(flat, batch), state


def _add_moments(sums: tuple[Array, Array], values: Array) -> tuple[Array, Array]:
    """Add the mean and the mean square of values."""
    return sums[0] + jnp.mean(values), sums[1] + jnp.mean(values**2)
