"""All tables of `sympol bench` as plain data: methods, variants, environments, cells, and the paper's numbers."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import product
from typing import Any, Literal, NamedTuple, TypeAlias

from .record import Cell, Record

CONTROL = ("CartPole-v1", "Acrobot-v1", "LunarLander-v3", "MountainCarContinuous-v0", "Pendulum-v1")
MINIGRID = (
    "MiniGrid-Empty-Random-6x6-v0",
    "MiniGrid-DoorKey-5x5-v0",
    "MiniGrid-LavaGapS5-v0",
    "MiniGrid-LavaGapS7-v0",
    "MiniGrid-DistShift1-v0",
)
_SHORT = ("CP", "AB", "LL", "MC-C", "PD-C", "E-R", "DK", "LG-5", "LG-7", "DS")
SHORT: Mapping[str, str] = dict(zip((*CONTROL, *MINIGRID), _SHORT, strict=True))
"""The paper's abbreviations of environments."""
CONTINUOUS = frozenset({"MountainCarContinuous-v0", "Pendulum-v1"})
"""Environments of the tables whose actions are continuous."""
TIMESTEPS = 1_000_000
"""Environment steps of a training in every table; a cell with another number shows it."""


class Method(NamedTuple):
    """A method of the tables, and how its policy is made."""

    label: str
    policy: Literal["tree", "mlp", "sdt"]
    """The policy that is trained (`Config.policy`); for a post-hoc tree that of its teacher."""
    teacher: str | None = None
    """The method whose trainings a post-hoc tree is made from."""
    preset: str = "default"
    depth: int | None = None
    """The depth of a distilled tree."""
    is_tree: bool = True
    """Whether the policy that acts in the end is a hard tree, which the paper calls interpretable."""
    discrete_only: bool = False


METHODS: Mapping[str, Method] = {
    "tree": Method("SYMPOL", "tree"),
    "d-sdt": Method("D-SDT", "sdt", "sdt"),
    "sa-dt-5": Method("SA-DT (d=5)", "mlp", "mlp", depth=5),
    "sa-dt-8": Method("SA-DT (d=8)", "mlp", "mlp", depth=8),
    "viper-5": Method("VIPER (d=5)", "mlp", "mlp", depth=5, discrete_only=True),
    "viper-8": Method("VIPER (d=8)", "mlp", "mlp", depth=8, discrete_only=True),
    "dagger-5": Method("DAgger (d=5)", "mlp", "mlp", depth=5),
    "dagger-8": Method("DAgger (d=8)", "mlp", "mlp", depth=8),
    "mlp": Method("MLP", "mlp", is_tree=False),
    "sdt": Method("SDT", "sdt", is_tree=False),
    "tree-paper": Method("SYMPOL, paper's settings", "tree", preset="paper"),
    "mlp-paper": Method("MLP, paper's settings", "mlp", preset="paper", is_tree=False),
    "sdt-paper": Method("SDT, paper's settings", "sdt", preset="paper", is_tree=False),
}
"""Methods by name. A name that is not here is shown as it is."""

_SAME_BATCHES = {
    # the paper aligned "step and batch size", so that the policies are compared and nothing else
    "num_envs": 8,
    "num_steps": 512,
    "minibatch_size": 64,
    "num_epochs": 7,
    "dynamic_rollout": True,
    "dynamic_batch": True,
}
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "tree-critic": {"critic": "tree"},
    "static-rollout": {"dynamic_rollout": False},
    "static-batch": {"dynamic_batch": False},
    "adam": {"weight_decay": 0.0},
    "softsign": {"surrogate": "softsign"},
    "temperature-0.5": {"temperature": 0.5},
    "temperature-2": {"temperature": 2.0},
    "decay-1e-3": {"weight_decay": 1e-3},
    "growth-16": {"growth": 16},
    "depth-5": {"depth": 5},
    "depth-9": {"depth": 9},
    "runtime": _SAME_BATCHES,
    # the paper's critics are not of one size, and the critic is most of the work
    "runtime-critic": {**_SAME_BATCHES, "critic_hidden": (256, 256)},
}
"""The fields of `Config` in which each variant differs from its method's preset."""

VARIANT_LABELS: Mapping[str, str] = {
    "tree-critic": "w/o separate architecture",
    "static-rollout": "w/o dynamic rollout",
    "static-batch": "w/o batch size adjustment",
    "adam": "w/o AdamW",
    "softsign": "softsign for the logistic function",
    "temperature-0.5": "surrogate temperature 0.5",
    "temperature-2": "surrogate temperature 2",
    "decay-1e-3": "weight decay 0.001",
    "growth-16": "growth stops at 16-fold",
    "depth-5": "depth 5",
    "depth-9": "depth 9",
    "runtime": "",
    "runtime-critic": "critics alike",
}
"""The label of each variant, shown beside its method's; a variant that is not here is shown by its name."""
PAPERS_VARIANTS = ("tree-critic", "static-rollout", "static-batch", "adam")
RUNTIME_VARIANTS = ("runtime", "runtime-critic")
"""Variants whose trainings of one seed take turns, so that other load on the machine slows all of them alike."""
OUR_VARIANTS = tuple(name for name in VARIANTS if name not in (*PAPERS_VARIANTS, *RUNTIME_VARIANTS))


def method_or_label(name: str) -> Method:
    """Return the method of a name; an unknown name gives a method that only has this label."""
    return METHODS.get(name, Method(name, "mlp", is_tree=False))


def label_of(cell: Cell) -> str:
    """Return the label of a cell's method and variant."""
    variant = VARIANT_LABELS.get(cell.variant, cell.variant)
    label = method_or_label(cell.method).label
    return f"{label}, {variant}" if variant else label


def exists(cell: Cell) -> bool:
    """Return whether a method of the tables is defined on an environment of the tables."""
    return not (method_or_label(cell.method).discrete_only and cell.environment in CONTINUOUS)


def is_tree(record: Record) -> bool:
    """Return whether a hard tree acted; for an unknown method, whether its record counts nodes."""
    return METHODS[record.method].is_tree if record.method in METHODS else record.nodes is not None


Quantity: TypeAlias = Literal["return", "validation", "cohens_d", "nodes", "seconds"]
MEAN = "mean"
"""In place of an environment: the paper's number for all environments together."""


def paper_number(quantity: Quantity, cell: Cell) -> float | None:
    """Return the paper's number for a cell, or None if it has none.

    Args:
        quantity: The quantity.
        cell: The cell; with `MEAN` as its environment, the mean that the paper prints.
    """
    numbers = _paper_numbers()[quantity]
    row = numbers.get("/".join((cell.algo, cell.method, *filter(None, [cell.variant]))), {})
    return row.get(cell.environment)


@cache
def _paper_numbers() -> dict[str, Any]:
    return json.loads((files("sympol.bench") / "paper.json").read_text(encoding="utf-8"))


Kind: TypeAlias = Literal["returns", "loss", "size", "runtime", "curves"]
Compared: TypeAlias = Literal["trees", "algos", "baseline", "nothing"]


class Row(NamedTuple):
    """One row of a table: a cell of each environment."""

    method: str
    variant: str = ""
    algo: str = "ppo"


@dataclass(frozen=True)
class Table:
    """The table that `sympol bench NAME` makes."""

    name: str
    title: str
    caption: str
    environments: tuple[str, ...]
    rows: tuple[Row, ...]
    kind: Kind = "returns"
    """The quantity that cells show."""
    compared: Compared = "nothing"
    """The cells that are tested against each other: within an environment and algorithm the hard trees; the algorithms
    of each method; or all rows, with each other and with the first."""
    reference_rows: tuple[Row, ...] = ()
    """The rows that define the normalised scores 0 and 1; all rows by default."""

    def cells(self) -> tuple[Cell, ...]:
        """Return all cells that can exist, those that teachers are trained in first."""
        cells = (cell_of(row, env) for row, env in product(self.rows, self.environments))
        possible = [cell for cell in cells if exists(cell)]
        return tuple(sorted(possible, key=lambda cell: bool(method_or_label(cell.method).teacher)))

    def with_(self, *, environments: Iterable[str] = (), methods: Iterable[str] = ()) -> Table:
        """Return the table with more environments, and with more methods for each of its algorithms."""
        algos = dict.fromkeys(row.algo for row in self.rows)
        rows = [Row(method, algo=algo) for method, algo in product(methods, algos)]
        return dataclasses.replace(
            self,
            environments=tuple(dict.fromkeys((*self.environments, *environments))),
            rows=tuple(dict.fromkeys((*self.rows, *rows))),
        )


def cell_of(row: Row, environment: str) -> Cell:
    """Return the cell of a row on an environment."""
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
