"""Published returns that stand beside our fronts, and the targets of our searches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from sympol.bench.record import Cell
from sympol.bench.tables import Quantity, paper_number
from sympol.search.front.plot import Reference


class Target(NamedTuple):
    """The return that a tree of at most ``nodes`` nodes should reach, on average over whole runs."""

    nodes: int
    mean: float | None
    """None where the target is no plain return; then ``words`` state it."""
    words: str = ""


_TREES: Mapping[str, tuple[Reference, ...]] = {
    "LunarLander-v3": (
        Reference("published", 209, 27),
        Reference("published", 253, 53),
        Reference("published, best of 50", 260, 63),
        Reference("oblique", 256, 31),
    ),
    "Pendulum-v1": (
        Reference("imitation", -325, 31),
        Reference("imitation", -261, 63),
        Reference("imitation", -181, 255),
        Reference("imitation", -165, 511),
    ),
    "Acrobot-v1": (Reference("published", -84, 3), Reference("published", -75, 173)),
    "MountainCarContinuous-v0": (Reference("published", 96, 3), Reference("published", 97, 61)),
}
"""The best published deterministic trees that we know of; docs/guides/pareto.md says where each is from."""
_NETWORKS: Mapping[str, float] = {"LunarLander-v3": 278, "Pendulum-v1": -150}
"""The best published neural networks that we know of."""
_GRID = Target(15, None, "99.8 % of each episode's optimum")
_TARGETS: Mapping[str, tuple[Target, ...]] = {
    "CartPole-v1": (Target(5, 500),),
    "Acrobot-v1": (Target(7, -82), Target(31, -78)),
    "LunarLander-v3": (Target(31, 240), Target(63, 260)),
    "MountainCarContinuous-v0": (Target(9, 97),),
    "Pendulum-v1": (Target(31, -230), Target(127, -165)),
    "MiniGrid-Empty-Random-6x6-v0": (_GRID,),
    "MiniGrid-DoorKey-5x5-v0": (_GRID,),
    "MiniGrid-LavaGapS5-v0": (_GRID,),
    "MiniGrid-LavaGapS7-v0": (_GRID,),
    "MiniGrid-DistShift1-v0": (_GRID,),
    "sympol/DistShift-Random-v0": (Target(31, None, "every layout solved"),),
}


def published(environment: str) -> list[Reference]:
    """Return the published returns of an environment: trees by size, then other policies.

    An environment that nobody reports on has none.
    """

    def paper(quantity: Quantity, method: str) -> float | None:
        return paper_number(quantity, Cell(environment, "ppo", method))

    found = [*_TREES.get(environment, ())]
    tree, nodes, mlp = paper("return", "tree"), paper("nodes", "tree"), paper("return", "mlp")
    if tree is not None and nodes is not None:
        found.append(Reference("SYMPOL, paper", tree, nodes))
    found.sort(key=lambda reference: reference.nodes or 0)
    if environment in _NETWORKS:
        found.append(Reference("network, published", _NETWORKS[environment]))
    if tree is not None and nodes is None:
        found.append(Reference("SYMPOL, paper", tree))
    if mlp is not None:
        found.append(Reference("MLP, paper", mlp))
    return found


def best_published(environment: str, nodes: int) -> Reference | None:
    """Return the published tree with the highest return among those of at most ``nodes`` nodes, if there is any."""
    small = [one for one in published(environment) if one.nodes is not None and one.nodes <= nodes]
    return max(small, key=lambda one: one.mean, default=None)


def targets(environment: str) -> tuple[Target, ...]:
    """Return the targets of an environment, by size; most environments have none."""
    return _TARGETS.get(environment, ())
