"""What training makes of a tree that it starts from, beside a training from scratch that is as long.

    python -m studies.benchmarks.warm_start [ENV ...]

CartPole starts from two leaves, as one would write them by hand: lean left, push left; lean right, push right.
LunarLander starts from a tree of depth 6 that DAgger made of Gymnasium's own controller, which nobody trained. Our
default presets but for the length. Test episodes on Gymnasium; writes studies/results/warm_start.json.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.box2d.lunar_lander import heuristic

import sympol
from sympol.play import play
from sympol.trees import DecisionTree, DiscreteActions

from .timing import arguments_of, write_environments

EPISODES = 100
TEST_SEED = 2026
UNSURE = 0.6
"""A confidence lower than the default: a poor tree had better try other actions."""


def two_leaves() -> DecisionTree:
    """Push to where the pole leans."""
    return DecisionTree.from_complete(
        np.array([2]),
        np.zeros(1, np.float32),
        np.eye(2),
        actions=DiscreteActions(2),
        feature_names=[f"x[{i}]" for i in range(4)],
    )


def of_the_controller() -> DecisionTree:
    """A tree of the controller that comes with LunarLander."""
    env = gymnasium.make("LunarLander-v3").unwrapped
    return sympol.distill_policy(
        lambda x: heuristic(env, x), "dagger", 6, env="LunarLander-v3", num_iterations=10
    )


STARTS: dict[str, tuple[Callable[[], DecisionTree], int, int]] = {
    "CartPole-v1": (two_leaves, 300_000, 5),
    "LunarLander-v3": (of_the_controller, 300_000, 3),
}
"""The tree, steps of each training, trainings."""


def train(env: str, seed: int, steps: int, start: sympol.Start | None) -> dict[str, Any]:
    """One training and its test."""
    began = time.perf_counter()
    agent = sympol.PPO("tree", env, seed=seed, start=start, total_timesteps=steps).learn(progress_bar=False)
    tree = agent.tree()
    test = play(tree, agent.spec, EPISODES, seed=TEST_SEED)
    row = {
        "seed": seed,
        "return_mean": float(test.returns.mean()),
        "nodes": tree.n_nodes,
        "seconds": round(time.perf_counter() - began, 1),
    }
    print(env, "from scratch" if start is None else f"from the tree at {start.confidence}", row, flush=True)
    return row


def measure(env: str) -> dict[str, Any]:
    """All trainings of an environment."""
    make, steps, trainings = STARTS[env]
    start = make()
    begun = play(start, sympol.resolve(env), EPISODES, seed=TEST_SEED)
    result: dict[str, Any] = {
        "timesteps": steps,
        "start": {"return_mean": float(begun.returns.mean()), "nodes": start.n_nodes, "depth": start.depth},
    }
    print(env, result["start"], flush=True)
    ways = {
        "from_the_tree": sympol.Start(start),
        "from_the_tree_unsure": sympol.Start(start, confidence=UNSURE),
        "from_scratch": None,
    }
    for name, way in ways.items():
        rows = [train(env, seed, steps, way) for seed in range(trainings)]
        returns = [row["return_mean"] for row in rows]
        result[name] = {
            "return_mean": float(np.mean(returns)),
            "return_std_over_trainings": float(np.std(returns, ddof=1)),
            "trainings": rows,
        }
    return result


def main() -> None:
    """Measure and write."""
    parser = arguments_of(__doc__)
    parser.add_argument("envs", nargs="*", metavar="ENV", default=list(STARTS))
    given = parser.parse_args()
    for env in given.envs:
        write_environments("warm_start", {"episodes": EPISODES, "test_seed": TEST_SEED}, {env: measure(env)})


if __name__ == "__main__":
    main()
