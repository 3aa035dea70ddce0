"""PPO with an MLP by stable-baselines3 and by rejax.

A script of its own, run by the interpreter of the rival's environment (`studies.benchmarks.rivals.environment`):

    python train.py sb3|rejax STEPS [ENV SEED]

It prints one line of JSON. Imports stand inside the functions because their seconds belong to the measurement.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import time
from typing import Any

ZOO: dict[str, dict[str, Any]] = {
    "Acrobot-v1": {"n_envs": 16, "normalize": True, "n_steps": 256, "gae_lambda": 0.94, "n_epochs": 4},
    "Pendulum-v1": {
        "n_envs": 4,
        "n_steps": 1024,
        "gae_lambda": 0.95,
        "gamma": 0.9,
        "n_epochs": 10,
        "learning_rate": 1e-3,
        "clip_range": 0.2,
        "use_sde": True,
        "sde_sample_freq": 4,
    },
}
"""The tuned settings that rl-baselines3-zoo has for these."""


def sb3(steps: int, env: str = "CartPole-v1", seed: int = 0) -> dict[str, float]:
    """stable-baselines3 on the CPU; on CartPole its defaults with eight environments, else the zoo's settings."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import VecNormalize

    settings = dict(ZOO.get(env, {"n_envs": 8}))
    envs = make_vec_env(env, n_envs=settings.pop("n_envs"), seed=1_000_000 * (seed + 1))
    normalize = settings.pop("normalize", False)
    envs = VecNormalize(envs) if normalize else envs
    agent = PPO("MlpPolicy", envs, seed=seed, device="cpu", **settings)
    began = time.perf_counter()
    agent.learn(steps)
    seconds = time.perf_counter() - began
    tests = make_vec_env(env, seed=99 + seed)
    if normalize:
        assert isinstance(envs, VecNormalize)
        tests = VecNormalize(tests, training=False, norm_reward=False)
        tests.obs_rms = envs.obs_rms
    mean, _ = evaluate_policy(agent, tests, n_eval_episodes=100)
    assert isinstance(mean, float)
    return {"training_seconds": seconds, "steps": steps, "return_mean": float(mean)}


def rejax(steps: int) -> dict[str, float]:
    """rejax's PPO: 32 environments, rollouts of 128, 4 epochs, as our preset."""
    import jax
    from rejax import PPO  # pyright: ignore[reportMissingImports]

    agent = PPO.create(
        env="CartPole-v1",
        num_envs=32,
        num_steps=128,
        num_epochs=4,
        num_minibatches=16,
        learning_rate=0.0003,
        total_timesteps=steps,
        eval_freq=steps // 20,
    )
    key = jax.random.PRNGKey(0)
    began = time.perf_counter()
    train = jax.jit(agent.train).lower(key).compile()
    compiled = time.perf_counter()
    _, (_, returns) = jax.block_until_ready(train(key))
    return {
        "compile_seconds": compiled - began,
        "training_seconds": time.perf_counter() - compiled,
        "steps": steps,
        "return_mean": float(returns[-1].mean()),
    }


if __name__ == "__main__":
    START = time.perf_counter()
    parser = argparse.ArgumentParser()
    parser.add_argument("name", choices=("sb3", "rejax"))
    parser.add_argument("steps", type=int)
    parser.add_argument("env", nargs="?", default="CartPole-v1")
    parser.add_argument("seed", nargs="?", type=int, default=0)
    given = parser.parse_args()
    result = rejax(given.steps) if given.name == "rejax" else sb3(given.steps, given.env, given.seed)
    seconds = time.perf_counter() - START
    packages = {"sb3": ("stable-baselines3", "torch", "gymnasium"), "rejax": ("rejax", "gymnax", "jax")}[
        given.name
    ]
    versions = {package: importlib.metadata.version(package) for package in packages}
    print(json.dumps({**result, "wall_seconds": seconds, "versions": versions}))
