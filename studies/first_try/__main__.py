"""How good are the defaults on environments that nobody tuned for? See README.md beside this file.

python -m studies.first_try run development --methods tree --seeds 0 1 --set num_epochs=10 --out FILE
python -m studies.first_try table FILE...
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from rich.console import Console

from ..benchmarks.timing import arguments_of
from .judge import due, read, run
from .table import of_one_library, render, rows, summary
from .worker import METHODS, SETS, tasks_of


def setting(text: str) -> tuple[str, Any]:
    """Read ``NAME=VALUE``, the value as JSON or else as text."""
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"a setting is NAME=VALUE, got {text!r}")
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


def main() -> None:
    """Run the command."""
    parser = arguments_of(__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run", help="measure what the file does not hold yet")
    runs.add_argument("tasks", choices=SETS)
    runs.add_argument("--methods", nargs="+", choices=METHODS, default=[*METHODS])
    runs.add_argument("--seeds", nargs="+", type=int, default=[*range(5)])
    runs.add_argument("--only", nargs="+", default=[], metavar="TASK", help="these tasks alone")
    runs.add_argument(
        "--set", nargs="+", type=setting, default=[], metavar="NAME=VALUE", help="arguments of sympol.PPO"
    )
    runs.add_argument("--out", type=Path, required=True, help="a file of JSON lines")
    runs.add_argument("--processes", type=int, default=1)
    tables = commands.add_parser("table", help="print shares")
    tables.add_argument("files", nargs="+", type=Path)
    tables.add_argument("--method", choices=METHODS, default="tree", help="the one that is judged")
    tables.add_argument(
        "--library", help="trees of the library with this hash, by default the last one measured"
    )
    tables.add_argument(
        "--set", nargs="+", type=setting, metavar="NAME=VALUE", help="trees with these settings"
    )
    given = parser.parse_args()
    if given.command == "run":
        unknown = {*given.only} - {*tasks_of(given.tasks)}
        if unknown:
            parser.error(f"no such task, or its package is missing: {', '.join(sorted(unknown))}")
        wanted = due(given.tasks, given.only, given.methods, given.seeds, dict(given.set))
        raise SystemExit(run(wanted, given.out, given.processes) > 0)
    settings = None if given.set is None else json.dumps(dict(given.set), sort_keys=True)
    found = rows(of_one_library(read(given.files), given.library, settings), given.method)
    Console(width=180).print(render(found, given.method))
    print(json.dumps(summary(found)))


if __name__ == "__main__":
    main()
