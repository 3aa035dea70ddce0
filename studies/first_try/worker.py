"""One record of the study: train a method on a task with a seed, and test what it has learnt.

    python -m studies.first_try.worker '{"set": "development", "env": "lake", "method": "rule", "seed": 0}'

`judge` runs it in a process of its own, so that no training meets what another one has left behind.
"""

from __future__ import annotations

import importlib.util
import json
import time
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

import sympol

from ..benchmarks.timing import arguments_of, machine
from . import development
from .tasks import Task

EPISODES = 100
TEST_SEED = 21_000_021
"""The seed of the test episodes, the same ones for all methods and seeds, which nothing else uses."""
UNTRAINED = ("random", "idle", "rule")
TRAINED = ("sb3", "mlp", "viper", "tree")
METHODS = (*UNTRAINED, *TRAINED)
"""`viper` is the tree distilled from the MLP of the same seed: both come from one training, whichever is named."""
SETS = ("development", "held_out", "fresh")


def tasks_of(name: str) -> dict[str, Task]:
    """Return the tasks of a set by name, without those whose packages are missing.

    Args:
        name: One of `SETS`.
    """
    module = development if name == "development" else importlib.import_module(f"{__package__}.{name}")
    tasks: tuple[Task, ...] = module.TASKS
    return {task.name: task for task in tasks if not task.needs or importlib.util.find_spec(task.needs)}


class Controller:
    """A function from observations to actions, with the method that stable-baselines3's policies have."""

    def __init__(self, choose: Callable[[Any], Any]) -> None:
        self.choose = choose

    def predict(self, observation: Any, *, deterministic: bool = True) -> tuple[Any, None]:
        """Return the action and no state."""
        return self.choose(observation), None


def untrained(task: Task, method: str, spec: Any, seed: int) -> Controller | None:
    """Return a policy that needs no training, or None where the task has none of this kind."""
    if method == "random":
        spec.action_space.seed(seed)
        return Controller(lambda _: spec.action_space.sample())
    if method == "idle":
        return None if task.idle is None else Controller(lambda _: task.idle)
    return None if task.rule is None else Controller(task.rule)


def sb3(task: Task, spec: Any, seed: int) -> tuple[Controller, int]:
    """Train the PPO of stable-baselines3 with its defaults; return its policy and the steps."""
    from stable_baselines3 import PPO

    env = spec.make_host()
    nested = isinstance(env.observation_space, gymnasium.spaces.Dict | gymnasium.spaces.Tuple)
    model = PPO("MultiInputPolicy" if nested else "MlpPolicy", env, seed=seed, device="cpu")
    model.learn(task.steps)
    discrete = isinstance(env.action_space, gymnasium.spaces.Discrete)

    def act(observation: Any) -> Any:
        action, _ = model.predict(observation, deterministic=True)
        return int(action) if discrete else action

    return Controller(act), model.num_timesteps


def tested(policy: Any, spec: Any) -> dict[str, Any]:
    """Return the returns of the test episodes, with the size of the policy if it is a tree."""
    began = time.perf_counter()
    returns = sympol.evaluate_policy(policy, spec, EPISODES, seed=TEST_SEED, return_episode_rewards=True)[0]
    size = {"nodes": int(policy.n_nodes)} if isinstance(policy, sympol.DecisionTree) else {}
    return {
        "return_mean": float(np.mean(returns)),
        "return_std": float(np.std(returns)),
        "test_seconds": round(time.perf_counter() - began, 1),
        **size,
    }


def measure(task: Task, method: str, seed: int, settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the records of a method; none where the task has no such method.

    Args:
        task: The task.
        method: One of `METHODS`; ``"mlp"`` and ``"viper"`` both return both.
        seed: The seed of the training, or of random actions.
        settings: Arguments of `sympol.PPO`, for the tree alone.
    """
    spec = sympol.resolve(task.env, backend="host")
    began = time.perf_counter()
    if method in UNTRAINED:
        policy = untrained(task, method, spec, seed)
        return (
            [] if policy is None else [{"method": method, "steps": 0, "seconds": 0.0, **tested(policy, spec)}]
        )
    if method == "sb3":
        policy, steps = sb3(task, spec, seed)
        seconds = round(time.perf_counter() - began, 1)
        return [{"method": method, "steps": steps, "seconds": seconds, **tested(policy, spec)}]
    kind, settings = ("tree", settings) if method == "tree" else ("mlp", {})
    agent = sympol.PPO(kind, task.env, seed=seed, **settings).learn(task.steps, progress_bar=False)
    trained = {"steps": agent.num_timesteps, "seconds": round(time.perf_counter() - began, 1)}
    if method == "tree":
        return [{"method": method, **trained, **tested(agent.tree(), spec)}]
    mlp = {"method": "mlp", **trained, **tested(agent, spec)}
    began, limits = time.perf_counter(), sympol.PPO("tree", task.env, total_timesteps=task.steps).config
    size = {"depth": limits.depth, "max_nodes": limits.max_nodes or None}
    tree = sympol.distill_policy(agent, seed=seed, **size)
    seconds = round(trained["seconds"] + time.perf_counter() - began, 1)
    return [mlp, {"method": "viper", "steps": trained["steps"], "seconds": seconds, **tested(tree, spec)}]


def main() -> None:
    """Read what to measure as JSON from the command line; print the records as the last line."""
    parser = arguments_of(__doc__)
    parser.add_argument("wanted", type=json.loads, metavar="JSON")
    given = parser.parse_args().wanted
    warnings.simplefilter("ignore")  # an environment without a time limit, equal episodes: the returns tell
    task = tasks_of(given["set"])[given["env"]]
    records = measure(task, given["method"], given["seed"], given.get("settings", {}))
    about = machine()
    about = {key: about[key] for key in ("date", "commit", "cpu", "load", "versions")}
    print(json.dumps([{**record, "machine": about} for record in records]))


if __name__ == "__main__":
    main()
