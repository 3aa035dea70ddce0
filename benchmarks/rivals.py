"""PPO with an MLP by stable-baselines3 and by rejax, on CartPole-v1: run by benchmarks.training, one process each.

    python benchmarks/rivals.py sb3|rejax STEPS

It needs a virtual environment of its own with `stable-baselines3` and `rejax`: their pins would hold back ours. Prints
one line of JSON. Imports stand inside the functions because their seconds belong to the measurement.
"""

from __future__ import annotations

import json
import sys
import time


def sb3(steps: int) -> dict[str, float]:
    """stable-baselines3 with its defaults and eight environments, on the CPU."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy

    agent = PPO("MlpPolicy", make_vec_env("CartPole-v1", n_envs=8, seed=0), seed=0, device="cpu")
    began = time.perf_counter()
    agent.learn(steps)
    seconds = time.perf_counter() - began
    mean, _ = evaluate_policy(agent, make_vec_env("CartPole-v1", seed=99), n_eval_episodes=20)
    return {"training_seconds": seconds, "steps": steps, "return_mean": float(mean)}


def rejax(steps: int) -> dict[str, float]:
    """rejax's PPO: 32 environments, rollouts of 128, 4 epochs, as our preset."""
    import jax
    from rejax import PPO

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
    result = {"sb3": sb3, "rejax": rejax}[sys.argv[1]](int(sys.argv[2]))
    print(json.dumps({**result, "wall_seconds": time.perf_counter() - START}))
