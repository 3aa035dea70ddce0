"""How a method's policy comes to be: trained, made of a teacher, or by a function of your own.

`methods` says what the methods of the tables are called; here is what is done for them.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, NamedTuple, TypeAlias

from ..agents import Agent, agent_class
from ..algorithms.config import Config
from ..distill import METHODS as DISTILLERS
from ..envs.registry import resolve
from ..envs.spec import EnvSpec
from ..parallel.task import resolve as find
from ..results.json_io import plain
from ..trees.actions import BoxActions
from .methods import METHODS, VARIANTS, Method
from .record import Cell

Make: TypeAlias = Callable[..., Any]
"""``make(spec, seed=, total_timesteps=, folder=)`` returns what acts: a `DecisionTree`, anything with an agent's
``act``, or a function from flat observations ``[batch, features]`` to actions."""


class Settings(NamedTuple):
    """What all cells of a bench have in common."""

    total_timesteps: int
    """Environment steps of each training."""
    episodes: int
    """Of each purpose, for each training."""


_OWN: dict[str, str] = {}
"""Where the function of each registered method is."""


def register_method(slug: str, make: Make | str) -> None:
    """Put a method of your own beside those of the tables.

    Args:
        slug: What it is called, in small letters: ``sympol bench control-ppo --methods tree SLUG``.
        make: The function (see `Make`), or where it is: ``"module:function"``. Workers import it from there.

    Raises:
        ValueError: the name of a method of the tables, or a function that no other process can import.
    """
    where = make if isinstance(make, str) else f"{make.__module__}:{make.__qualname__}"
    find(where)
    if slug in METHODS:
        raise ValueError(f"{slug} is a method of the tables already; call yours something else")
    if not slug or slug.strip("abcdefghijklmnopqrstuvwxyz0123456789._+-") or not slug[0].isalnum():
        raise ValueError(f"a method's name must be of small letters, digits and '._+-', got {slug!r}")
    _OWN[slug] = where


def own(slug: str) -> str | None:
    """Where the function of a registered method is; None for those of the tables."""
    return _OWN.get(slug)


def method_of(slug: str) -> Method:
    """What is known of a method. Raises ValueError for an unknown one, naming all."""
    if slug in _OWN:
        return Method(slug, "mlp", is_tree=False)
    found = METHODS.get(slug)
    if found is None:
        raise ValueError(
            f"unknown method {slug!r}; there are {', '.join([*METHODS, *_OWN])}; one of your own is given "
            "as NAME=MODULE:FUNCTION"
        )
    return found


def teacher_cell(cell: Cell) -> Cell | None:
    """The cell whose trainings this one's trees are made of."""
    teacher = None if cell.method in _OWN else method_of(cell.method).teacher
    return None if teacher is None else cell._replace(method=teacher)


def applies(cell: Cell) -> bool:
    """Whether the method is defined on the environment at all."""
    continuous = isinstance(environment(cell.environment).actions, BoxActions)
    return not (method_of(cell.method).discrete_only and continuous)


@cache
def environment(name: str) -> EnvSpec:
    """The environment of a cell, which must have a form in Gymnasium to be tested on.

    Raises:
        ValueError: it is not known, or has no such form.
    """
    spec = resolve(name)
    if spec.make_host is None:
        raise ValueError(
            f"{name} is written in JAX and has no form in Gymnasium, which tests are played on; give one: "
            "sympol.register(..., host=...)"
        )
    return spec


def import_all(modules: Iterable[str]) -> None:
    """Import what registers environments and methods. Raises ValueError, naming the module."""
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise ValueError(f"cannot import {module!r}: {error}; is it on PYTHONPATH?") from error


def agent_for(cell: Cell, seed: int, total_timesteps: int) -> Agent:
    """The agent that a trained cell trains, not yet trained.

    Raises:
        ValueError: an unknown variant, or one that does not fit the method.
    """
    method = method_of(cell.method)
    if cell.variant and cell.variant not in VARIANTS:
        raise ValueError(f"unknown variant {cell.variant!r}; there are {', '.join(VARIANTS)}")
    overrides = {**VARIANTS.get(cell.variant, {}), "total_timesteps": total_timesteps}
    spec = environment(cell.environment)
    return agent_class(cell.algo)(method.policy, spec, seed=seed, preset=method.preset, **overrides)


def config_of(cell: Cell, settings: Settings) -> dict[str, Any]:
    """Everything that decides what a cell's numbers are but its seeds: `Record.config`."""
    config: dict[str, Any] = {"episodes": settings.episodes}
    if (where := own(cell.method)) is not None:
        if cell.variant:
            raise ValueError(
                f"{cell.method} is made by {where}, which knows no variants, got {cell.variant!r}"
            )
        return {**config, "make": where, "training": {"total_timesteps": settings.total_timesteps}}
    if (teacher := teacher_cell(cell)) is not None:
        return {**config_of(teacher, settings), "distill": distilling(cell.method)}
    agent = agent_for(cell, 0, settings.total_timesteps)
    return {**config, "preset": agent.preset, "training": agent.config.to_dict()}


def distilling(slug: str) -> dict[str, Any]:
    """How a tree is made of a teacher: the arguments of `sympol.distill.distill`, or discretizing."""
    depth = method_of(slug).depth
    if depth is None:
        return {"method": "discretize"}
    name = slug.rsplit("-", 1)[0]
    parameters = inspect.signature(DISTILLERS[name]).parameters.items()
    options = {key: of.default for key, of in parameters if isinstance(of.default, int) and key != "seed"}
    return {"method": name, **options, "depth": depth}


def same_config(was: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Whether two cells were made alike. Fields that a training did not have yet were what they are by default."""
    return _filled(was) == _filled(now)


def _filled(config: Mapping[str, Any]) -> dict[str, Any]:
    training = config.get("training", {})
    which = {name: training[name] for name in ("policy", "algorithm") if name in training}
    defaults = Config(**which).to_dict() if which else {}
    return plain({**config, "training": {**defaults, **training}})
