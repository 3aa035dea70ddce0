"""The training loop as a person would write it: Python loops, one environment and one sample at a time.

No fori, no scan, no while, no buffer, no micro-batches, no Optax: a rollout is a list, a batch is one array, the
tree is the textbook's product, Adam is three lines of NumPy. Only the random numbers are drawn as the program
draws them. Slow, in float64, and hard to get wrong.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sympol.algorithms.config import Config, Hyperparameters
from sympol.algorithms.initialization import purpose_key
from sympol.algorithms.state import TrainState
from sympol.envs.spaces import UNBOUNDED
from sympol.functional.shuffle import Shuffle
from sympol.policies.distributions import Categorical, Distribution
from tests.functional.oracle import plain_tree, textbook_tree

Params = dict[str, list[np.ndarray]]
TREE = ("feature_logits", "thresholds", "leaf_values")


class Sample(NamedTuple):
    x: np.ndarray
    action: np.ndarray
    reward: float
    terminated: bool
    truncated: bool
    last_x: np.ndarray


class Reference:
    """Trains from a fresh state of the compiled program (whose timestep may be anywhere in the training)."""

    def __init__(
        self,
        env: Any,
        distribution: Distribution,
        config: Config,
        hyper: Hyperparameters,
        seed: int,
        state: TrainState,
    ) -> None:
        self.env, self.distribution, self.config, self.hyper, self.seed = (
            env,
            distribution,
            config,
            hyper,
            seed,
        )
        self.reset, self.step = jax.jit(env.reset), jax.jit(env.step)
        actor = [np.asarray(getattr(state.networks.actor, name), np.float64) for name in (*TREE, "log_std")]
        leaves = jax.tree.leaves(state.networks.critic)
        self.critic_is_tree = config.critic == "tree"
        critic = [np.asarray(leaf, np.float64) for leaf in (leaves[:3] if self.critic_is_tree else leaves)]
        self.params: Params = {"actor": actor, "critic": critic}
        self.m = jax.tree.map(np.zeros_like, self.params)
        self.v = jax.tree.map(np.zeros_like, self.params)
        self.num_updates = 0
        self.key = jax.random.wrap_key_data(jnp.asarray(state.key))
        self.timestep, self.iteration = int(state.timestep), 0
        self.shift, self.scale = np.asarray(state.normalizer.shift), np.asarray(state.normalizer.scale)
        num_envs = config.num_envs
        self.env_states = [jax.tree.map(lambda a, e=e: a[e], state.env_state) for e in range(num_envs)]
        self.observations = [np.asarray(state.observation[e]) for e in range(num_envs)]
        self.lr_factor = 1.0
        self._gradient = jax.jit(jax.grad(self.loss))

    # --- the policy and the value, one after the other ---

    def outputs(self, x: np.ndarray) -> np.ndarray:
        return plain_tree(*(p.astype(np.float32) for p in self.params["actor"][:3]), x)

    def value(self, x: np.ndarray) -> np.ndarray:
        if self.critic_is_tree:
            return plain_tree(*(p.astype(np.float32) for p in self.params["critic"]), x)[:, 0]
        *hidden, (weight, bias) = self._layers(self.params["critic"])
        h = x.astype(np.float64)
        for w, b in hidden:
            h = np.tanh(h @ w + b)
        return (h @ weight + bias)[:, 0]

    @staticmethod
    def _layers(critic: list[Any]) -> list[tuple[Any, Any]]:
        half = len(critic) // 2
        return list(zip(critic[:half], critic[half:], strict=True))

    def sample(self, output: np.ndarray, noise: np.ndarray) -> np.ndarray:
        if isinstance(self.distribution, Categorical):
            return np.int32(np.argmax(output + noise))
        return (output + np.exp(self.params["actor"][3]) * noise).astype(np.float32)

    def log_prob(self, output: np.ndarray, action: np.ndarray) -> float:
        if isinstance(self.distribution, Categorical):
            return float(output[int(action)] - np.log(np.exp(output.astype(np.float64)).sum()))
        log_std = self.params["actor"][3]
        z = (action - output) / np.exp(log_std)
        return float(-0.5 * (z**2).sum() - (log_std + 0.5 * math.log(2 * math.pi)).sum())

    def to_env(self, action: Any) -> Any:
        if isinstance(self.distribution, Categorical):
            return jnp.int32(action)
        return jnp.clip(
            jnp.asarray(action), jnp.asarray(self.env.action_space.low), self.env.action_space.high
        )

    def scaled(self, observation: Any) -> np.ndarray:
        return (np.asarray(observation) - self.shift) * self.scale

    # --- one iteration ---

    def iterate(self) -> None:
        total = self.config.total_timesteps
        k = math.ceil(8 * (self.timestep + 1) / (total + 1)) - 1 if self.config.dynamic_rollout else 0
        k = min(k, self.config.max_stage)
        self.key, collect_key, learn_key = jax.random.split(self.key, 3)
        rollout = self.collect(2**k, collect_key)
        if self.iteration == 0 and not self.bounded().all():
            self.warm_up(rollout)
        else:
            self.learn(rollout, k, learn_key)
        self.timestep += self.config.chunk_size * 2**k
        self.iteration += 1

    def collect(self, num_chunks: int, key: jax.Array) -> list[list[Sample]]:
        """One list for each step, one sample in it for each environment."""
        shape = (self.config.chunk_steps, self.config.num_envs)
        rollout = []
        for chunk in range(num_chunks):
            act, world = jax.random.split(jax.random.fold_in(key, chunk))
            noise = np.asarray(self.distribution.noise(act, shape))
            step_keys, reset_keys = jax.random.split(world, (2, *shape))
            for t in range(shape[0]):
                rollout.append(
                    [
                        self.step_one(e, noise[t, e], step_keys[t, e], reset_keys[t, e])
                        for e in range(shape[1])
                    ]
                )
        return rollout

    def step_one(self, e: int, noise: np.ndarray, step_key: jax.Array, reset_key: jax.Array) -> Sample:
        x = self.scaled(self.observations[e])
        action = self.sample(self.outputs(x[None])[0], noise)
        self.env_states[e], result = self.step(step_key, self.env_states[e], self.to_env(action))
        ended = bool(result.terminated), bool(result.truncated)
        last = np.asarray(result.observation)
        self.observations[e] = last
        if any(ended):
            self.env_states[e], first = self.reset(reset_key)
            self.observations[e] = np.asarray(first)
        return Sample(x, action, float(result.reward), *ended, self.scaled(last))

    def bounded(self) -> np.ndarray:
        space = self.env.observation_space
        finite = (np.abs(space.low) < UNBOUNDED) & (np.abs(space.high) < UNBOUNDED)
        return (finite & self.config.trust_bounds) | (not self.config.normalize_obs)

    def warm_up(self, rollout: list[list[Sample]]) -> None:
        x = np.stack([sample.x for row in rollout[: self.config.chunk_steps] for sample in row])
        for f in np.flatnonzero(~self.bounded()):
            self.shift, self.scale = self.shift.copy(), self.scale.copy()
            self.shift[f], self.scale[f] = x[:, f].mean(), 0.5 / x[:, f].std()

    def learn(self, rollout: list[list[Sample]], k: int, key: jax.Array) -> None:
        samples = self.with_advantages(rollout)
        n = len(samples["advantage"])
        if self.config.norm_adv:
            advantage = samples["advantage"]
            samples["advantage"] = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        num_batches = self.config.num_minibatches
        if not self.config.dynamic_batch:
            num_batches *= 2**k
        for epoch in range(self.config.num_epochs):
            epoch_key = jax.random.fold_in(key, epoch)
            shuffle = Shuffle.create(epoch_key, self.config.chunk_size, 2**self.config.max_stage)
            order = np.asarray(shuffle(jnp.arange(n, dtype=jnp.int32), jnp.int32(k)))
            for rows in np.split(order, num_batches):
                self.update({name: column[rows] for name, column in samples.items()})

    def with_advantages(self, rollout: list[list[Sample]]) -> dict[str, np.ndarray]:
        """A_t = δ_t + γλ·A_{t+1}, one environment and one step at a time, and what the loss needs beside it."""
        gamma, lam = float(self.hyper.gamma), float(self.hyper.gae_lambda)
        num_steps, num_envs = len(rollout), self.config.num_envs
        advantage, value = np.zeros((num_steps, num_envs)), np.zeros((num_steps, num_envs))
        for e in range(num_envs):
            next_advantage = 0.0
            next_value = self.value(self.scaled(self.observations[e])[None])[0]
            for t in reversed(range(num_steps)):
                s = rollout[t][e]
                value[t, e] = self.value(s.x[None])[0]
                if s.terminated:
                    next_value = next_advantage = 0.0
                elif s.truncated:
                    next_value, next_advantage = self.value(s.last_x[None])[0], 0.0
                reward = float(self.hyper.reward_scale) * s.reward
                advantage[t, e] = reward + gamma * next_value - value[t, e] + gamma * lam * next_advantage
                next_advantage, next_value = advantage[t, e], value[t, e]
        flat = [s for row in rollout for s in row]
        outputs = self.outputs(np.stack([s.x for s in flat]))
        return {
            "x": np.stack([s.x for s in flat]).astype(np.float64),
            "action": np.stack([s.action for s in flat]),
            "log_prob": np.array([self.log_prob(o, s.action) for o, s in zip(outputs, flat, strict=True)]),
            "advantage": advantage.ravel(),
            "value_target": (advantage + value).ravel(),
        }

    # --- the update ---

    def loss(self, params: Any, batch: Any, ent_coef: Any) -> Any:
        """Schulman et al. 2017, eq. 9, over the textbook tree."""
        feature_logits, thresholds, leaf_values, log_std = params["actor"]
        outputs = textbook_tree(feature_logits, thresholds, leaf_values, batch["x"], self.config.surrogate)
        if isinstance(self.distribution, Categorical):
            log_p = outputs - jnp.log(jnp.sum(jnp.exp(outputs), axis=1, keepdims=True))
            log_prob = log_p[jnp.arange(len(log_p)), batch["action"]]
            entropy = -jnp.mean(jnp.sum(jnp.exp(log_p) * log_p, axis=1))
        else:
            z = (batch["action"] - outputs) / jnp.exp(log_std)
            log_prob = jnp.sum(-0.5 * z**2 - log_std - 0.5 * math.log(2 * math.pi), axis=1)
            entropy = jnp.sum(log_std + 0.5 * math.log(2 * math.pi * math.e))
        ratio = jnp.exp(log_prob - batch["log_prob"])
        eps = float(self.hyper.clip_eps)
        surrogate = jnp.minimum(
            ratio * batch["advantage"], jnp.clip(ratio, 1 - eps, 1 + eps) * batch["advantage"]
        )
        if self.critic_is_tree:
            value = textbook_tree(*params["critic"], batch["x"], self.config.surrogate)[:, 0]
        else:
            *hidden, (weight, bias) = self._layers(params["critic"])
            h = batch["x"]
            for w, b in hidden:
                h = jnp.tanh(h @ w + b)
            value = (h @ weight + bias)[:, 0]
        value_loss = 0.5 * jnp.mean((value - batch["value_target"]) ** 2)
        return -jnp.mean(surrogate) + float(self.hyper.vf_coef) * value_loss - ent_coef * entropy

    def update(self, batch: dict[str, np.ndarray]) -> None:
        """One step of AdamW, whatever the size of the batch."""
        hyper, progress = self.hyper, self.timestep / self.config.total_timesteps
        ent_coef = float(hyper.ent_coef) * (1 + (float(hyper.ent_end_factor) - 1) * progress)
        with jax.enable_x64(True), jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
            gradient = self._gradient(self.params, batch, ent_coef)
        gradient = jax.tree.map(lambda g: np.asarray(g, np.float64), gradient)
        self.num_updates += 1
        factor = self.lr_factor * (1 + (float(hyper.lr_end_factor) - 1) * progress)
        for part, names in (("actor", [*TREE, "log_std"]), ("critic", None)):
            norm = math.sqrt(sum((g**2).sum() for g in gradient[part]))
            clip = min(1.0, float(hyper.max_grad_norm) / norm) if norm > 0 else 1.0
            for i, g in enumerate(gradient[part]):
                name = names[i] if names else "critic"
                m = self.m[part][i] = 0.9 * self.m[part][i] + 0.1 * clip * g
                v = self.v[part][i] = 0.999 * self.v[part][i] + 0.001 * (clip * g) ** 2
                m, v = m / (1 - 0.9**self.num_updates), v / (1 - 0.999**self.num_updates)
                direction = m / (np.sqrt(v) + 1e-5)
                if name in ("feature_logits", "leaf_values"):
                    direction = direction + float(hyper.weight_decay) * self.params[part][i]
                rate = float(getattr(hyper, f"learning_rate_{name}"))
                self.params[part][i] = self.params[part][i] - factor * rate * direction

    # --- validation ---

    def validate(self) -> float:
        """Mean return of the deterministic tree, one episode after the other."""
        returns = []
        key = purpose_key(jnp.uint32(self.seed), "validation")
        for reset_key, step_key in zip(
            *jax.random.split(key, (2, self.config.num_eval_episodes)), strict=True
        ):
            env_state, observation = self.reset(reset_key)
            total, time, done = 0.0, 0, False
            while not done and time < self.env.max_episode_steps:
                output = self.outputs(self.scaled(observation)[None])[0]
                action = np.argmax(output) if isinstance(self.distribution, Categorical) else output
                env_state, result = self.step(
                    jax.random.fold_in(step_key, time), env_state, self.to_env(action)
                )
                observation, done = result.observation, bool(result.terminated | result.truncated)
                total, time = total + float(result.reward), time + 1
            returns.append(total)
        return float(np.mean(returns))
