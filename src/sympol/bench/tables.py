"""All tables of `sympol bench`, as plain data: which cells each needs and what it shows of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Literal, NamedTuple, TypeAlias

from .methods import CONTROL, METHODS, MINIGRID, OUR_VARIANTS, PAPERS_VARIANTS, VARIANTS, exists, known
from .record import Cell

__all__ = ["CONTROL", "METHODS", "MINIGRID", "TABLES", "TIMESTEPS", "VARIANTS", "Row", "Table", "cell_of"]

TIMESTEPS = 1_000_000
"""Environment steps of a training in every table; a cell with others says so."""

Kind: TypeAlias = Literal["returns", "loss", "size", "runtime", "curves"]
Compared: TypeAlias = Literal["trees", "algos", "baseline", "nothing"]


class Row(NamedTuple):
    """One row: a cell of each environment."""

    method: str
    variant: str = ""
    algo: str = "ppo"


@dataclass(frozen=True)
class Table:
    """What `sympol bench NAME` makes."""

    name: str
    title: str
    caption: str
    environments: tuple[str, ...]
    rows: tuple[Row, ...]
    kind: Kind = "returns"
    """What is shown of the cells."""
    compared: Compared = "nothing"
    """Within an environment and algorithm the hard trees with each other; each method's algorithms with each other; or
    all rows with each other and with the first."""
    reference_rows: tuple[Row, ...] = ()
    """The rows that say what a normalised score of 0 and 1 is; all, if none are given."""

    def cells(self) -> tuple[Cell, ...]:
        """All cells it shows, teachers' first, without those that cannot be."""
        cells = (cell_of(row, env) for row, env in product(self.rows, self.environments))
        possible = [cell for cell in cells if exists(cell)]
        return tuple(sorted(possible, key=lambda cell: bool(known(cell.method).teacher)))

    def with_(self, *, environments: Iterable[str] = (), methods: Iterable[str] = ()) -> Table:
        """The same table with more environments, and more methods for each of its algorithms."""
        algos = dict.fromkeys(row.algo for row in self.rows)
        rows = [Row(method, algo=algo) for method, algo in product(methods, algos)]
        return dataclasses.replace(
            self,
            environments=tuple(dict.fromkeys((*self.environments, *environments))),
            rows=tuple(dict.fromkeys((*self.rows, *rows))),
        )


def cell_of(row: Row, environment: str) -> Cell:
    """The cell of a row."""
    return Cell(environment, row.algo, row.method, row.variant)


def _rows(*methods: str, variant: str = "", algos: Iterable[str] = ("ppo",)) -> tuple[Row, ...]:
    return tuple(Row(method, variant, algo) for method, algo in product(methods, algos))


_FULL = ("mlp", "sdt")
_TREES = ("tree", "d-sdt", "sa-dt-5", "sa-dt-8")
_VIPER = (*_TREES, "viper-5", "viper-8")
_PAIRS = (*_FULL, "tree", "sa-dt-5", "sa-dt-8", "d-sdt")
_PAPERS_ABLATION = (Row("tree-paper"), *(Row("tree-paper", variant) for variant in PAPERS_VARIANTS))
_BOLD = "Test return. Bold: the best hard tree, and those that do not differ from it."


def _of_returns(
    name: str, title: str, environments: tuple[str, ...], trees: tuple[str, ...], algo: str = "ppo"
) -> Table:
    rows = _rows(*trees, *_FULL, algos=[algo])
    return Table(name, title, _BOLD, environments, rows, "returns", "trees")


_ALL = (
    _of_returns("control-ppo", "Control with PPO", CONTROL, _TREES),
    _of_returns("control-a2c", "Control with A2C", CONTROL, _TREES, "a2c"),
    Table(
        "ppo-vs-a2c",
        "PPO against A2C",
        "Test return. Bold: of each method's two algorithms the better, and the other if it does not differ.",
        CONTROL,
        _rows(*_PAIRS, algos=["ppo", "a2c"]),
        "returns",
        "algos",
    ),
    _of_returns("minigrid", "MiniGrid with PPO", MINIGRID, _TREES),
    Table(
        "information-loss",
        "Information loss",
        "Validation return of the policy that was trained, and test return of the one that is applied.",
        CONTROL,
        _rows(*_PAIRS),
        "loss",
    ),
    _of_returns("viper-control", "VIPER on control", CONTROL, _VIPER),
    _of_returns("viper-minigrid", "VIPER on MiniGrid", MINIGRID, _VIPER),
    Table(
        "tree-size",
        "Tree size",
        "Nodes of the pruned tree, inner nodes and leaves.",
        CONTROL,
        _rows(*_TREES),
        "size",
    ),
    Table(
        "ablation",
        "Ablations",
        "Test return of SYMPOL with the paper's settings and one thing changed. Bold: the best row, and those that do "
        "not differ from it; ▲ better, ▼ worse than the first row.",
        CONTROL,
        (*_PAPERS_ABLATION, *(Row("tree-paper", variant) for variant in OUR_VARIANTS)),
        "returns",
        "baseline",
        _PAPERS_ABLATION,
    ),
    Table(
        "runtime",
        "Runtime",
        "Seconds that a training took, without compiling; rollouts and batches are the same for all.",
        CONTROL,
        _rows("tree-paper", "sdt-paper", "mlp-paper", variant="runtime")
        + _rows("tree-paper", "mlp-paper", variant="runtime-critic"),
        "runtime",
    ),
    Table(
        "training-curves",
        "Training curves",
        "Validation return, its mean over the whole training.",
        CONTROL,
        _rows("tree", *_FULL, "d-sdt", "sa-dt-5", "sa-dt-8"),
        "curves",
    ),
)
TABLES: Mapping[str, Table] = {table.name: table for table in _ALL}
