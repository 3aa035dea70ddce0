"""What stands in the rows and columns of the tables: methods, variants, environments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

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
"""The paper's abbreviations."""
CONTINUOUS = frozenset({"MountainCarContinuous-v0", "Pendulum-v1"})
"""Environments of the tables whose actions are continuous."""


class Method(NamedTuple):
    """How a cell of a method is made."""

    label: str
    policy: Literal["tree", "mlp", "sdt"]
    """What is trained (`Config.policy`): for a post-hoc tree its teacher."""
    teacher: str | None = None
    """The method whose trainings a post-hoc tree is made from."""
    preset: str = "default"
    depth: int | None = None
    """Of a distilled tree."""
    is_tree: bool = True
    """Whether what acts in the end is a hard tree: interpretable, in the paper's words."""
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
"""By slug. A slug that is not here is shown as it is."""

_ALIKE = {
    # the paper aligned "step and batch size", so that what is compared is the policies
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
    "runtime": _ALIKE,
    # the paper's critics are not of one size, and the critic is most of the work
    "runtime-critic": {**_ALIKE, "critic_hidden": (256, 256)},
}
"""What each variant changes of its method's preset, as fields of `algos.config.Config`."""

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
"""What a row is called beside its method; a variant that is not here is shown by its name."""
PAPERS_VARIANTS = ("tree-critic", "static-rollout", "static-batch", "adam")
RUNTIME_VARIANTS = ("runtime", "runtime-critic")
"""Their trainings of one seed take turns, so that what else the machine does meets all."""
OUR_VARIANTS = tuple(name for name in VARIANTS if name not in (*PAPERS_VARIANTS, *RUNTIME_VARIANTS))


def known(method: str) -> Method:
    """The method of a slug; of an unknown one only its label is."""
    return METHODS.get(method, Method(method, "mlp", is_tree=False))


def label_of(cell: Cell) -> str:
    """What a cell's row is called."""
    variant = VARIANT_LABELS.get(cell.variant, cell.variant)
    return f"{known(cell.method).label}, {variant}" if variant else known(cell.method).label


def exists(cell: Cell) -> bool:
    """Whether the method is defined on the environment at all."""
    return not (known(cell.method).discrete_only and cell.environment in CONTINUOUS)


def is_tree(record: Record) -> bool:
    """Whether a hard tree acted: a method that is not known is asked for its nodes."""
    return METHODS[record.method].is_tree if record.method in METHODS else record.nodes is not None
