"""What MiniGrid's trees earn on Farama's package, beside the best that each episode allows.

    python -m studies.benchmarks.minigrid [ENV ...] [--seeds N] [--timesteps N] [--episodes N]

Five trainings from scratch a task, one million steps, our default presets, seeds 0 to 4. Each pruned, deterministic
tree plays 100 test episodes; the shortest way from each episode's start, which is known, gives the greatest return
there is. Then, on the task's graph, whether the tree comes to the goal in time from every start there is (for the
randomised DistShift: in all 56 layouts), and on every observation that can be reached, whether the policy as trained
and all its readers act alike. Writes studies/results/minigrid.json, every seed in it, beside the paper's numbers.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from studies.benchmarks.no_loss import disagreements
from tests.envs.minigrid_worlds import optimal_returns

import sympol
from sympol.envs.capabilities import steps_to_goal
from sympol.envs.minigrid import MiniGrid
from sympol.envs.minigrid.state_graph import all_starts
from sympol.envs.spec import EnvSpec
from sympol.play import episode_seed, play
from sympol.search.evaluators.tabular import play_table
from sympol.trees import DecisionTree

from .timing import arguments_of, write_environments

PAPER = {  # mean return, table of the paper
    "MiniGrid-Empty-Random-6x6-v0": 0.964,
    "MiniGrid-DoorKey-5x5-v0": 0.959,
    "MiniGrid-LavaGapS5-v0": 0.951,
    "MiniGrid-LavaGapS7-v0": 0.953,
    "MiniGrid-DistShift1-v0": 0.939,
    "sympol/DistShift-Random-v0": None,
}
TEST_SEED = 2026


def best_returns(spec: EnvSpec, num_episodes: int) -> np.ndarray:
    """The greatest return in each of the test episodes that `play` plays."""
    assert isinstance(spec.env, MiniGrid)
    assert spec.make_host is not None
    hosts = [spec.make_host() for _ in range(num_episodes)]
    for episode, host in enumerate(hosts):
        host.reset(seed=episode_seed(TEST_SEED, episode))
    return optimal_returns(spec.env, hosts)


def returns_from_all_starts(tree: DecisionTree, env: MiniGrid) -> tuple[np.ndarray, np.ndarray]:
    """What the tree earns from each start, following the graph, and the most that can be earned there."""
    graph, starts = env.state_graph(), all_starts(env)  # pyright: ignore[reportArgumentType]
    assert graph is not None
    assert starts is not None
    state, limit = graph.index(starts), env.max_episode_steps
    best = 1 - 0.9 * (steps_to_goal(graph.successor, graph.reaches_goal)[state] / limit)
    returns, lengths = play_table(graph, tree.predict(graph.observations)[None], state)
    earned = np.where(returns[0] > 0, 1 - 0.9 * (lengths[0] / limit), 0.0)  # not rounded
    return earned, best


def measure(env: str, seed: int, episodes: int, options: dict[str, Any]) -> dict[str, Any]:
    """Train and test one seed."""
    began = time.perf_counter()
    agent = sympol.PPO("tree", env, seed=seed, **options)
    agent.learn(progress_bar=False)
    seconds = time.perf_counter() - began
    tree, full, x = agent.tree(), agent.tree(prune=False), agent.spec.all_observations()
    assert agent.state is not None
    assert x is not None
    assert isinstance(agent.spec.env, MiniGrid)
    returns, best = (
        play(tree, agent.spec, episodes, seed=TEST_SEED).returns,
        best_returns(agent.spec, episodes),
    )
    solved = returns_from_all_starts(tree, agent.spec.env)[0] > 0
    return {
        "seed": seed,
        "return_mean": float(returns.mean()),
        "return_std": float(returns.std()),
        "best_return_mean": float(best.mean()),
        "share_of_best_mean": float((returns / best).mean()),
        "success_rate": float((returns > 0).mean()),
        "starts": len(solved),
        "starts_solved": int(solved.sum()),
        "validation_return": float(agent.state.validation.best_return),
        "nodes": tree.n_nodes,
        "nodes_by_groups": full.prune().n_nodes,
        "nodes_unpruned": full.n_nodes,
        "observations": len(x),
        "disagreements": disagreements(agent, x),
        "timesteps": agent.num_timesteps,
        "seconds": round(seconds, 2),
        "compile_seconds": round(agent.compile_seconds, 2),
    }


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("envs", nargs="*", metavar="ENV", default=list(PAPER))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--timesteps", type=int, help="of each training; else the preset's")
    parser.add_argument("--episodes", type=int, default=100)
    given = parser.parse_args()
    options = {} if given.timesteps is None else {"total_timesteps": given.timesteps}
    results: dict[str, Any] = {}
    columns = ("return", "paper", "of the best", "every seed", "starts solved", "nodes", "every seed")
    table = Table("task", *columns, "disagree", "s each")
    for env in given.envs:
        rows = []
        for seed in range(given.seeds):
            rows.append(measure(env, seed, given.episodes, options))
            print(env, rows[-1], flush=True)
        results[env] = summary(rows) | {"paper_return": PAPER.get(env), "trainings": rows}
        table.add_row(env.removeprefix("MiniGrid-"), *cells(results[env]))
    Console().print(table)
    settings = {"episodes": given.episodes, "test_seed": TEST_SEED, "preset": "default", **options}
    print(write_environments("minigrid", settings, results))


def summary(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Over the seeds."""
    means = {
        key: np.array([row[key] for row in rows]) for key in ("return_mean", "share_of_best_mean", "nodes")
    }
    return {
        "return_mean": float(means["return_mean"].mean()),
        "return_std_over_trainings": float(means["return_mean"].std(ddof=1)) if len(rows) > 1 else 0.0,
        "share_of_best_mean": float(means["share_of_best_mean"].mean()),
        "nodes_mean": float(means["nodes"].mean()),
        "starts_solved": sum(row["starts_solved"] for row in rows) / sum(row["starts"] for row in rows),
        "disagreements": sum(sum(row["disagreements"].values()) for row in rows),
    }


def cells(result: dict[str, Any]) -> list[str]:
    """A row of the table."""
    rows, paper = result["trainings"], result["paper_return"]
    return [
        f"{result['return_mean']:.3f} ± {result['return_std_over_trainings']:.3f}",
        "" if paper is None else f"{paper:.3f}",
        f"{result['share_of_best_mean']:.1%}",
        " ".join(f"{100 * row['share_of_best_mean']:.1f}" for row in rows),
        f"{result['starts_solved']:.1%}",
        f"{result['nodes_mean']:.1f}",
        " ".join(str(row["nodes"]) for row in rows),
        str(result["disagreements"]),
        f"{np.mean([row['seconds'] for row in rows]):.0f}",
    ]


if __name__ == "__main__":
    main()
