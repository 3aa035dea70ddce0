"""An off-policy algorithm in one file: Q-learning with a replay buffer and a target network (Mnih et al., 2015).

It is here to show what a new algorithm needs, and that the loop serves one that is not on-policy.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from sympol.algorithms.algorithm import Algorithm, Experience, Metrics
from sympol.algorithms.optim import apply_gradients
from sympol.algorithms.state import Networks, TrainState
from sympol.types import Transition

CAPACITY = 4096
BATCH = 64
UPDATES = 8
SHARPNESS = 10.0
"""Actions are drawn in proportion to exp(10 Q) while experience is collected."""


class Memory(NamedTuple):
    """A ring of transitions, and the networks of the target."""

    transitions: Transition
    written: Array
    target: Networks


class QLearning(Algorithm):
    """The actor's outputs are action values; the greedy action is the largest."""

    def init_memory(self, networks: Networks) -> Memory:
        """Create an empty buffer."""
        x = jnp.zeros((CAPACITY, self.num_features))
        zeros, no = jnp.zeros(CAPACITY), jnp.zeros(CAPACITY, bool)
        transitions = Transition(x, jnp.zeros(CAPACITY, jnp.int32), zeros, no, no, x)
        return Memory(transitions, jnp.int32(0), networks)

    def sample(self, outputs: Array, log_std: Array, noise: Array) -> Any:
        """Explore in proportion to the exponential of the values."""
        return self.distribution.sample(SHARPNESS * outputs, log_std, noise)

    def update(
        self, hyper: Any, state: TrainState, experience: Experience, key: Array
    ) -> tuple[TrainState, Metrics]:
        """Store the rollout, take some steps on random batches, and move the target."""
        memory = self._stored(state.memory, experience)
        rate = jnp.float32(1)

        def loss(networks: Networks, batch: Transition, target: Networks) -> Array:
            future = jnp.max(target.actor(batch.last_observation), axis=-1)
            goal = batch.reward + hyper.gamma * jnp.where(batch.terminated, 0.0, future)
            value = jnp.take_along_axis(networks.actor(batch.observation), batch.action[:, None], axis=-1)
            return jnp.mean((value[:, 0] - goal) ** 2)

        def step(carry: Any, key: Array) -> Any:
            networks, opt_state = carry
            rows = jax.random.randint(key, (BATCH,), 0, jnp.minimum(memory.written, CAPACITY))
            batch = jax.tree.map(lambda a: a[rows], memory.transitions)
            td_loss, gradient = jax.value_and_grad(loss)(networks, batch, memory.target)
            return apply_gradients(networks, gradient, opt_state, hyper, rate), td_loss

        carry = (state.networks, state.opt_state)
        (networks, opt_state), losses = jax.lax.scan(step, carry, jax.random.split(key, UPDATES))
        target = jax.tree.map(lambda old, new: 0.8 * old + 0.2 * new, memory.target, networks)
        state = state._replace(networks=networks, opt_state=opt_state, memory=memory._replace(target=target))
        return state, {"train/td_loss": jnp.mean(losses)}

    def _stored(self, memory: Memory, experience: Experience) -> Memory:
        chunk = jax.tree.map(lambda a: a[0].reshape(-1, *a.shape[3:]), experience.rollout)
        rows = (memory.written + jnp.arange(chunk.reward.shape[0])) % CAPACITY
        transitions = jax.tree.map(lambda a, b: a.at[rows].set(b), memory.transitions, chunk)
        return memory._replace(transitions=transitions, written=memory.written + chunk.reward.shape[0])
