"""``sympol verify``: properties of a tree, proven or refuted."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.text import Text

from ..runs.metadata import RunError
from ..trees import DecisionTree
from ..trees.actions import BoxActions
from ..trees.floats import printable, shortest
from ..trees.verify import (
    Property,
    Verdict,
    action_range,
    action_regions,
    equal,
    margin,
    noise,
    read_properties,
    unreachable_leaves,
    verify,
)
from .arguments import Folder, PlaysRun, parse
from .console import out
from .tree_io import spec_from, tree_from

FILE = "safety.toml"
_QUANTILES = {"least": 0.0, "1 %": 0.01, "5 %": 0.05, "25 %": 0.25, "median": 0.5}


@dataclass
class Verify(PlaysRun):
    """Prove what a tree always or never does, or find an observation where it does otherwise.

    The exit status is 0 if everything holds, 1 if something fails, 2 after bad input.
    """

    tree: Folder
    """A run's folder, a policy.json, or a listing in a .txt."""

    properties: Path | None = None
    """A file of [[property]] tables; by default the safety.toml in the run's folder, if there is one."""

    property: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """One more rule, such as "when pole angle > 0.1 then action is push right"; may be given several times."""

    against: Path | None = None
    """Another tree, in any of these forms: prove that both act alike."""

    everywhere: bool = False
    """For --property and --against: include observations outside the bounds of the space, infinities and NaN."""

    robustness: int = 0
    """Number of episodes to play, to measure how far their observations are from another action."""

    noise: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=SIZE ...")] = ()
    """With --robustness: errors of features, such as "pole angle=0.01": can they change the action?"""

    seed: int = 0
    """Seed of the episodes."""

    json: bool = False
    """Print only one line of JSON."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol verify``."""
    given = parse(Verify, "verify", words)
    tree = tree_from(given.tree)
    verdicts = list(verify(tree, _properties(given)))
    if given.against is not None:
        other = tree_from(given.against)
        verdicts.append(equal(tree, other, within_bounds=not given.everywhere))
    robust = _robustness(given, tree)
    if given.json:
        found = {
            "properties": [_verdict_json(verdict) for verdict in verdicts],
            "unreachable_leaves": unreachable_leaves(tree).tolist(),
            "features": list(tree.feature_names),
        }
        print(json.dumps(found if robust is None else {**found, "robustness": robust}, allow_nan=False))
    else:
        for verdict in verdicts:
            _print_verdict(verdict)
        if verdicts:
            held = sum(verdict.holds for verdict in verdicts)
            out.print(f"{held} of {len(verdicts)} hold")
        if robust is not None:
            _print_robustness(robust)
        elif not verdicts:
            _print_summary(tree)
    return 0 if all(verdict.holds for verdict in verdicts) else 1


def _properties(given: Verify) -> list[Property]:
    """Return the properties of the file and of the command line."""
    path = given.properties
    if path is None and (given.tree / FILE).exists():
        path = given.tree / FILE
    try:
        of_file = () if path is None else read_properties(path)
    except OSError as error:
        raise RunError(f"{path} cannot be read: {error.strerror or error}") from error
    return [*of_file, *(Property(rule, within_bounds=not given.everywhere) for rule in given.property)]


def _verdict_json(verdict: Verdict) -> dict[str, Any]:
    return {
        "name": verdict.name,
        "rule": verdict.rule,
        "holds": verdict.holds,
        "vacuous": verdict.vacuous,
        "leaves": verdict.n_leaves,
        "violating_leaves": verdict.n_violating,
        "counterexample": [
            {
                "observation": _observation_json(example.observation),
                "words": example.where,
                "action": example.action,
            }
            for example in verdict.examples
        ],
    }


def _observation_json(observation: np.ndarray) -> list[float | str]:
    """Return an observation for strict JSON: infinity and NaN become strings, as in policy.json."""
    return [shortest(x) if np.isfinite(x) else str(float(x)) for x in observation]


def _print_verdict(verdict: Verdict) -> None:
    mark, style = ("✓", "green") if verdict.holds else ("✗", "bold red")
    if verdict.vacuous:
        mark, style = "○", "yellow"
    out.print(Text.assemble((mark, style), " ", printable(verdict.name)))
    out.print(Text(f"  {verdict.words}", "" if verdict.holds and not verdict.vacuous else style))


def _print_summary(tree: DecisionTree) -> None:
    unreachable = unreachable_leaves(tree)
    gone = f"; {len(unreachable)} cannot be reached: {unreachable.tolist()}" if len(unreachable) else ""
    out.print(f"{tree.n_leaves} leaves{gone}", markup=False)
    if isinstance(tree.actions, BoxActions):
        for name, (low, high) in action_range(tree).items():
            out.print(f"  {printable(name)} from {low:.7g} to {high:.7g}", markup=False)
    else:
        for one in action_regions(tree):
            count = f"{len(one.leaves)} {'leaf' if len(one.leaves) == 1 else 'leaves'}"
            only = f", only where {one.only_where}" if one.only_where else ""
            out.print(f"  {one.action}: {count}{only}", markup=False)
    out.print('say what has to hold: --property "when … then …", or a safety.toml', style="dim")


def _robustness(given: Verify, tree: DecisionTree) -> dict[str, Any] | None:
    if given.robustness < 0:
        raise ValueError(f"--robustness must be a number of episodes, 1 or more, got {given.robustness}")
    sizes = _sizes(given.noise)
    if given.robustness == 0:
        if sizes:
            raise ValueError("--noise needs observations: give --robustness EPISODES, too")
        return None
    from ..play import play

    seen = play(tree, spec_from(given.tree, tree, given), given.robustness, seed=given.seed).observations
    unit = seen.std(axis=0, dtype=np.float64)
    radius = margin(tree, seen, unit).radius
    least = np.quantile(radius, list(_QUANTILES.values()), method="lower")
    quantiles = zip(_QUANTILES, least.tolist(), strict=True)
    found: dict[str, Any] = {
        "observations": len(seen),
        "unit": {name: float(size) for name, size in zip(tree.feature_names, unit, strict=True)},
        "margin": {name: float(x) if np.isfinite(x) else "inf" for name, x in quantiles},
        "no_other_action": float(np.isinf(radius).mean()),
    }
    if sizes:
        harm = noise(tree, seen, sizes)
        found["noise"] = {"size": sizes, "share": harm.share, "by_feature_alone": dict(harm.by_feature)}
    return found


def _sizes(given: Sequence[str]) -> dict[str, float]:
    sizes: dict[str, float] = {}
    for argument in given:
        name, _, size = argument.rpartition("=")
        try:
            sizes[name] = float(size)
        except ValueError:
            sizes[name] = np.nan
        if not name or not 0 <= sizes[name] < np.inf:
            raise ValueError(
                f"--noise must be of the form NAME=SIZE with a size of 0 or more, as in 'pole angle=0.01', got "
                f"{argument!r}"
            )
    return sizes


def _print_robustness(found: Mapping[str, Any]) -> None:
    quantiles = ", ".join(f"{name} {float(x):.3g}" for name, x in found["margin"].items())
    out.print(
        f"margins over {found['observations']:,} visited observations, in standard deviations of each feature: "
        f"{quantiles}",
        markup=False,
    )
    if found["no_other_action"]:
        out.print(
            f"  {found['no_other_action']:.1%} can get no other action".replace("%", " %"), markup=False
        )
    if "noise" in found:
        harm = found["noise"]
        sizes = ", ".join(f"{printable(name)} ± {size:g}" for name, size in harm["size"].items())
        alone = [f"{printable(name)} alone {share:.1%}" for name, share in harm["by_feature_alone"].items()]
        words = f"{sizes}: the action can change in {harm['share']:.1%} of them"
        out.print((f"{words} ({', '.join(alone)})" if alone else words).replace("%", " %"), markup=False)
