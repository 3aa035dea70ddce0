"""What the trees earn: five trainings from scratch an environment, a hundred test episodes each, on Gymnasium.

    python -m studies.benchmarks.returns [ENV ...]

One million steps, our default presets, seeds 0 to 4: none of them was used to choose a hyperparameter (those were 1000
and up). Writes studies/results/returns.json, every seed in it, beside the paper's numbers.
"""

from __future__ import annotations

import time

import numpy as np
from rich.console import Console
from rich.table import Table

import sympol
from sympol.play import play

from .timing import arguments_of, write_environments

PAPER = {  # mean return and nodes, tables of the paper
    "CartPole-v1": (500, 39.4),
    "Acrobot-v1": (-79.9, 78.6),
    "MountainCarContinuous-v0": (94.3, 23.4),
    "Pendulum-v1": (-323.3, 56.2),
    "LunarLander-v3": (-57.4, 55.0),
}
SEEDS = range(5)
EPISODES = 100
TEST_SEED = 2026


def measure(env: str) -> list[dict[str, float]]:
    """Train and test every seed."""
    rows = []
    for seed in SEEDS:
        began = time.perf_counter()
        agent = sympol.PPO("tree", env, seed=seed)
        agent.learn(progress_bar=False)
        seconds = time.perf_counter() - began
        tree, full = agent.tree(), agent.tree(prune=False)
        test = play(tree, agent.spec, EPISODES, seed=TEST_SEED)
        sampled = play(full, agent.spec, EPISODES, seed=TEST_SEED, deterministic=False)
        assert agent.state is not None
        rows.append(
            {
                "seed": seed,
                "return_mean": float(test.returns.mean()),
                "return_std": float(test.returns.std()),
                "sampled_return_mean": float(sampled.returns.mean()),
                "validation_return": float(agent.state.validation.best_return),
                "nodes": tree.n_nodes,
                "nodes_unpruned": full.n_nodes,
                "timesteps": agent.num_timesteps,
                "seconds": round(seconds, 2),
            }
        )
        print(env, rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("envs", nargs="*", metavar="ENV", default=list(PAPER))
    given = parser.parse_args()
    results = {}
    table = Table("environment", "return", "every seed", "paper", "nodes", "every seed", "paper", "s each")
    for env in given.envs:
        rows = measure(env)
        returns, nodes = (np.array([row[key] for row in rows]) for key in ("return_mean", "nodes"))
        paper_return, paper_nodes = PAPER.get(env, (float("nan"), float("nan")))
        results[env] = {
            "return_mean": float(returns.mean()),
            "return_std_over_trainings": float(returns.std(ddof=1)),
            "nodes_mean": float(nodes.mean()),
            "paper_return": paper_return,
            "paper_nodes": paper_nodes,
            "trainings": rows,
        }
        table.add_row(
            env,
            f"{returns.mean():.1f} ± {returns.std(ddof=1):.1f}",
            " ".join(f"{r:.0f}" for r in returns),
            f"{paper_return:g}",
            f"{nodes.mean():.1f}",
            " ".join(str(n) for n in nodes),
            f"{paper_nodes:g}",
            f"{np.mean([row['seconds'] for row in rows]):.0f}",
        )
    Console().print(table)
    settings = {"episodes": EPISODES, "test_seed": TEST_SEED, "preset": "default"}
    print(write_environments("returns", settings, results))


if __name__ == "__main__":
    main()
