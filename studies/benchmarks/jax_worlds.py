"""One task of each library of environments in JAX: trained, evaluated and reported by sympol's commands.

    python -m studies.benchmarks.jax_worlds [ID ...] [--steps N]

Each runs in an environment with that library alone (studies/benchmarks/rivals/world_*.txt); with gymnax 0.0.9, rejax
trains an MLP on the same environment in the same run. Updates studies/results/jax_worlds.json, task by task.
"""

from __future__ import annotations

import json

from rich.console import Console
from rich.table import Table

from .rivals.environment import FOLDER, last_line
from .timing import ROOT, arguments_of, write

TASKS = {
    "gymnax:CartPole-v1": ("gymnax0", "gymnax"),
    "gymnax:Breakout-MinAtar": ("gymnax0", "gymnax"),
    "jumanji:Snake-v1": ("jumanji",),
    "navix:Navix-Empty-5x5-v0": ("navix",),
    "pgx:minatar-breakout": ("pgx",),
    "brax:inverted_pendulum": ("brax",),
    "playground:CartpoleBalance": ("playground",),
    "craftax:Craftax-Classic-Symbolic-v1": ("craftax",),
}
"""The environments in which each is run."""


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("ids", nargs="*", help="the tasks, by default all")
    parser.add_argument("--steps", type=int, default=100_000, help="of each training")
    given = parser.parse_args()
    file = ROOT / "studies" / "results" / "jax_worlds.json"
    results = json.loads(file.read_text())["tasks"] if file.exists() else {}
    table = Table("task", "library", "who", "steps/s", "compiling", "return")
    for env_id in given.ids or TASKS:
        for library in TASKS[env_id]:
            try:
                measured = json.loads(last_line(f"world_{library}", FOLDER / "world.py", env_id, given.steps))
            except RuntimeError as error:
                measured = {"failed": str(error)[-300:]}
            results.setdefault(env_id, {})[library] = measured
            for who, one in measured.items():
                if isinstance(one, dict):
                    row = [one[k] for k in ("steps_per_second", "compile_seconds", "return_mean")]
                    table.add_row(env_id, library, who, *(f"{v:,.4g}" for v in row))
            write("jax_worlds", {"settings": {"steps": given.steps}, "tasks": results})
    Console().print(table)


if __name__ == "__main__":
    main()
