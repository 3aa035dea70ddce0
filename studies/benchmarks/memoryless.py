"""How good can any policy be that sees 3 × 3 cells and remembers nothing? An exact bound for MiniGrid's small tasks.

    python -m studies.benchmarks.memoryless [ENV ...]

A tree gives one action an observation, and in MiniGrid many states look alike, so that the shortest way from each
start may not be open to it. The best policy of this kind is found as a mixed-integer program: probability flows from
the starts through the states to the goal, a binary variable says which action an observation gets, and only that
action may carry flow out of the states that look so. A start may be given up at the price of its whole return. The
solver's dual bound holds for every deterministic policy without memory, trees or not. Writes
studies/results/memoryless.json.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array, csr_array
from tests.envs import minigrid_worlds

from sympol.envs.capabilities import steps_to_goal
from sympol.envs.minigrid import make

from .minigrid import PAPER
from .timing import arguments_of, write

TIME_LIMIT = 300.0
"""Seconds; the bound holds also where the search was cut short."""


def measure(name: str) -> dict[str, Any]:
    """Bound the mean share of the optimum, over all starts by their probability."""
    env = make(name)
    graph = env.state_graph()
    assert graph is not None
    observations, look = graph.observations, graph.observation_of
    num_states, num_actions = graph.successor.shape

    starts, probability = minigrid_worlds.all_starts(env)
    first = graph.index(starts)
    best = 1 - 0.9 * steps_to_goal(graph.successor, graph.reaches_goal)[first] / env.max_episode_steps
    mass = np.bincount(first, probability / best, num_states)  # what starts there, weighed for a share

    # variables: flow through (state, action), what is given up at a state, and which action a look gets
    num_flows, num_choices = num_states * num_actions, len(observations) * num_actions
    flow = np.arange(num_flows).reshape(num_states, num_actions)
    choice = num_flows + num_states + np.arange(num_choices).reshape(-1, num_actions)
    num_variables = num_flows + num_states + num_choices
    leads_on = graph.successor >= 0
    useless = (~leads_on & ~graph.reaches_goal) | (graph.successor == np.arange(num_states)[:, None])

    def matrix(rows: Any, columns: Any, values: Any, num_rows: int) -> csr_array:
        return coo_array((values, (rows, columns)), shape=(num_rows, num_variables)).tocsr()

    out = matrix(np.repeat(np.arange(num_states), num_actions), flow.ravel(), np.ones(num_flows), num_states)
    into = matrix(graph.successor[leads_on], flow[leads_on], np.ones(leads_on.sum()), num_states)
    given_up = matrix(
        np.arange(num_states), num_flows + np.arange(num_states), np.ones(num_states), num_states
    )
    chosen = matrix(
        np.tile(np.arange(num_flows), 2),
        np.concatenate([flow.ravel(), choice[look].ravel()]),
        np.repeat([1.0, -mass.sum()], num_flows),
        num_flows,
    )
    one_each = matrix(
        np.repeat(np.arange(len(choice)), num_actions), choice.ravel(), np.ones(num_choices), len(choice)
    )

    cost = np.zeros(num_variables)
    cost[:num_flows] = 0.9 / env.max_episode_steps
    cost[num_flows : num_flows + num_states] = 1
    upper = np.full(num_variables, np.inf)
    upper[flow[useless]] = 0
    upper[num_flows : num_flows + num_states] = mass
    upper[choice.ravel()] = 1
    began = time.perf_counter()
    result = milp(
        cost,
        constraints=[
            LinearConstraint(out - into + given_up, mass, mass),  # pyright: ignore[reportArgumentType]
            LinearConstraint(chosen, -np.inf, 0),
            LinearConstraint(one_each, 1, 1),
        ],
        integrality=np.isin(np.arange(num_variables), choice).astype(int),
        bounds=Bounds(np.zeros(num_variables), upper),  # pyright: ignore[reportArgumentType]
        options={"time_limit": TIME_LIMIT, "mip_rel_gap": 1e-6},
    )
    return {
        "states": num_states,
        "observations": len(observations),
        "optimum_mean": float(probability @ best),
        "share_bound": float(mass.sum() - result.mip_dual_bound),
        "share_found": None if result.fun is None else float(mass.sum() - result.fun),
        "seconds": round(time.perf_counter() - began, 1),
    }


def main() -> None:
    """Solve, print, write."""
    parser = arguments_of(__doc__)
    tasks = [name for name in PAPER if name.startswith("MiniGrid")]
    parser.add_argument("envs", nargs="*", metavar="ENV", default=tasks)
    given = parser.parse_args()
    results = {}
    table = Table("task", "states", "observations", "optimum", "best without memory", "bound", "s")
    for name in given.envs:
        results[name] = row = measure(name)
        table.add_row(
            name,
            str(row["states"]),
            str(row["observations"]),
            f"{row['optimum_mean']:.4f}",
            "–" if row["share_found"] is None else f"{row['share_found']:.4%}",
            f"{row['share_bound']:.4%}",
            f"{row['seconds']:.0f}",
        )
    Console().print(table)
    print(write("memoryless", {"time_limit": TIME_LIMIT, "tasks": results}))


if __name__ == "__main__":
    main()
