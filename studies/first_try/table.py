"""The share of the best other method that a method reaches, above random play."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, NamedTuple

from rich.table import Table

from .judge import Record

LEARNERS = ("sb3", "mlp", "viper")
OTHERS = ("rule", *LEARNERS)


class Row(NamedTuple):
    """The results on one environment.

    Attributes:
        env: Its name.
        medians: The median return over the seeds, by method.
        best: The name of the best other method.
        returns: The returns of the method that is judged, by seed.
        shares: (return − random) / (best of the others − random), by seed; empty where no other beats random.
        of_learners: The median share beside those that learn, without the rule.
        nodes: The median size of its trees, if they are trees.
    """

    env: str
    medians: Mapping[str, float]
    best: str
    returns: Sequence[float]
    shares: Sequence[float]
    of_learners: float | None
    nodes: float | None

    @property
    def share(self) -> float | None:
        """The median share."""
        return median(self.shares) if self.shares else None

    @property
    def is_harmful(self) -> bool:
        """Whether the median is worse than random play or than doing nothing."""
        ours = median(self.returns) if self.returns else float("inf")
        return ours < max(self.medians.get(name, float("-inf")) for name in ("random", "idle"))


def of_one_library(
    records: Sequence[Record], library: str | None = None, settings: str | None = None
) -> list[Record]:
    """Return the records with the trees of one version of the defaults, by default the last one measured."""

    def group(record: Record) -> tuple[str, str]:
        return record["library"], json.dumps(record["settings"], sort_keys=True)

    trees = [
        record
        for record in records
        if record["method"] == "tree"
        and record["library"].startswith(library or "")
        and settings in (None, group(record)[1])
    ]
    last = {group(record) for record in trees[-1:]}
    return [record for record in records if record["method"] != "tree" or group(record) in last]


def rows(records: Sequence[Record], method: str = "tree") -> list[Row]:
    """Return a row for each environment, in the order of the records."""
    found: dict[str, dict[str, dict[int, Record]]] = defaultdict(lambda: defaultdict(dict))
    for record in records:
        found[record["env"]][record["method"]][record["seed"]] = record
    return [_row(env, by_method, method) for env, by_method in found.items()]


def _row(env: str, found: Mapping[str, Mapping[int, Record]], method: str) -> Row:
    medians = {
        name: median(record["return_mean"] for record in by_seed.values()) for name, by_seed in found.items()
    }
    others = [name for name in OTHERS if name in medians and name != method]
    best = max(others, key=lambda name: medians[name], default="")
    ours = [found[method][seed] for seed in sorted(found.get(method, {}))]
    returns = [record["return_mean"] for record in ours]
    low = medians.get("random", float("nan"))

    def shares(names: Sequence[str]) -> list[float]:
        high = max((medians[name] for name in names), default=float("nan"))
        return [(each - low) / (high - low) for each in returns] if high > low else []

    learned = shares([name for name in others if name in LEARNERS])
    sizes = [record["nodes"] for record in ours if "nodes" in record]
    return Row(
        env,
        medians,
        best,
        returns,
        shares(others),
        median(learned) if learned else None,
        median(sizes) if sizes else None,
    )


def render(found: Sequence[Row], method: str = "tree") -> Table:
    """Return the table for the terminal."""
    names = ("random", "idle", *OTHERS)
    shown = [name for name in names if name != method]
    table = Table("environment", *shown, method, "nodes", "share", "by seed", "of learners")
    for row in found:
        cells = [f"{row.medians[name]:.4g}" if name in row.medians else "" for name in shown]
        ours = f"{row.medians[method]:.4g}" if method in row.medians else ""
        share = "" if row.share is None else f"{row.share:.2f}" + (" harmful" if row.is_harmful else "")
        by_seed = " ".join(f"{each:.2f}" for each in row.shares)
        learned = "" if row.of_learners is None else f"{row.of_learners:.2f}"
        nodes = "" if row.nodes is None else f"{row.nodes:.0f}"
        table.add_row(row.env, *cells, ours, nodes, share, by_seed, learned)
    return table


def summary(found: Sequence[Row]) -> dict[str, Any]:
    """Return the median and the least share over the environments, and how many are worse than doing nothing."""
    shares = [row.share for row in found if row.share is not None]
    learned = [row.of_learners for row in found if row.of_learners is not None]
    return {
        "environments": len(shares),
        "median_share": round(median(shares), 3) if shares else None,
        "least_share": round(min(shares), 3) if shares else None,
        "median_of_learners": round(median(learned), 3) if learned else None,
        "harmful": sum(row.is_harmful for row in found),
    }
