"""The agents, distillers and functions that make the policy of a method.

`tables` names the methods: a policy is trained, distilled from a teacher, or returned by a function of the user's.
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
from ..parallel.task import import_function
from ..results.json_io import plain
from ..trees.actions import BoxActions
from .record import Cell
from .tables import METHODS, VARIANTS, Method

Make: TypeAlias = Callable[..., Any]
"""``make(spec, seed=, total_timesteps=, folder=)`` returns a policy: a `DecisionTree`, anything with an agent's
``act``, or a function from flat observations ``[batch, features]`` to actions."""


class Settings(NamedTuple):
    """The settings that all cells of a call of the bench have in common."""

    total_timesteps: int
    """Environment steps of each training."""
    episodes: int
    """Test episodes of each training, and as many for validation."""


_REGISTERED: dict[str, str] = {}
"""The function of each registered method, as ``"module:function"``."""


def register_method(name: str, make: Make | str) -> None:
    """Add a method of your own to those of the tables.

    Args:
        name: Its name, in lower case: ``sympol bench control-ppo --methods tree NAME``.
        make: The function (see `Make`), or ``"module:function"``. Workers import it from there.

    Raises:
        ValueError: The name is that of a method of the tables or has other characters, or no other process can import
            the function.
    """
    where = make if isinstance(make, str) else f"{make.__module__}:{make.__qualname__}"
    import_function(where)
    if name in METHODS:
        raise ValueError(f"{name} is a method of the tables already; call yours something else")
    if not name or name.strip("abcdefghijklmnopqrstuvwxyz0123456789._+-") or not name[0].isalnum():
        raise ValueError(f"a method's name must be of small letters, digits and '._+-', got {name!r}")
    _REGISTERED[name] = where


def registered(name: str) -> str | None:
    """Return the function of a registered method as ``"module:function"``; None for a method of the tables."""
    return _REGISTERED.get(name)


def method_of(name: str) -> Method:
    """Return the method of a name.

    Raises:
        ValueError: There is no such method; the message names all.
    """
    if name in _REGISTERED:
        return Method(name, "mlp", is_tree=False)
    found = METHODS.get(name)
    if found is None:
        raise ValueError(
            f"unknown method {name!r}; there are {', '.join([*METHODS, *_REGISTERED])}; one of your own is given "
            "as NAME=MODULE:FUNCTION"
        )
    return found


def teacher_cell(cell: Cell) -> Cell | None:
    """Return the cell whose trainings are the teachers of this one's trees, or None."""
    teacher = None if cell.method in _REGISTERED else method_of(cell.method).teacher
    return None if teacher is None else cell._replace(method=teacher)


def applies(cell: Cell) -> bool:
    """Return whether a cell's method is defined on its environment, whichever it is."""
    continuous = isinstance(environment(cell.environment).actions, BoxActions)
    return not (method_of(cell.method).discrete_only and continuous)


@cache
def environment(name: str) -> EnvSpec:
    """Return the environment of a cell.

    Raises:
        ValueError: It is unknown.
    """
    return resolve(name)


def import_all(modules: Iterable[str]) -> None:
    """Import modules that register environments and methods.

    Raises:
        ValueError: A module cannot be imported; the message names it.
    """
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise ValueError(f"cannot import {module!r}: {error}; is it on PYTHONPATH?") from error


def agent_for(cell: Cell, seed: int, total_timesteps: int) -> Agent:
    """Return the agent of a cell whose method is trained, before its training.

    Args:
        cell: The cell.
        seed: Seed of the training.
        total_timesteps: Environment steps of the training.

    Raises:
        ValueError: The variant is unknown, or does not fit the method.
    """
    method = method_of(cell.method)
    if cell.variant and cell.variant not in VARIANTS:
        raise ValueError(f"unknown variant {cell.variant!r}; there are {', '.join(VARIANTS)}")
    overrides = {**VARIANTS.get(cell.variant, {}), "total_timesteps": total_timesteps}
    spec = environment(cell.environment)
    return agent_class(cell.algo)(method.policy, spec, seed=seed, preset=method.preset, **overrides)


def config_of(cell: Cell, settings: Settings) -> dict[str, Any]:
    """Return everything that decides a cell's numbers, except for its seeds: `Record.config`.

    Args:
        cell: The cell.
        settings: Lengths of trainings and numbers of episodes.

    Raises:
        ValueError: The method or variant is unknown, or they do not fit each other.
    """
    config: dict[str, Any] = {"episodes": settings.episodes}
    if (where := registered(cell.method)) is not None:
        if cell.variant:
            raise ValueError(
                f"{cell.method} is made by {where}, which knows no variants, got {cell.variant!r}"
            )
        return {**config, "make": where, "training": {"total_timesteps": settings.total_timesteps}}
    if (teacher := teacher_cell(cell)) is not None:
        return {**config_of(teacher, settings), "distill": distill_options(cell.method)}
    agent = agent_for(cell, 0, settings.total_timesteps)
    return {**config, "preset": agent.preset, "training": agent.config.to_dict()}


def distill_options(name: str) -> dict[str, Any]:
    """Return how a method makes a tree from its teacher: the arguments of `sympol.distill.distill`, or discretising."""
    depth = method_of(name).depth
    if depth is None:
        return {"method": "discretize"}
    distiller = name.rsplit("-", 1)[0]
    parameters = inspect.signature(DISTILLERS[distiller]).parameters.items()
    options = {key: of.default for key, of in parameters if isinstance(of.default, int) and key != "seed"}
    return {"method": distiller, **options, "depth": depth}


def same_config(was: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Return whether two configs are equal. Fields that an older version did not have count as their defaults.

    Args:
        was: The config of a record.
        now: The config of today.
    """
    return _filled(was) == _filled(now)


def _filled(config: Mapping[str, Any]) -> dict[str, Any]:
    training = config.get("training", {})
    which = {name: training[name] for name in ("policy", "algorithm") if name in training}
    defaults = Config(**which).to_dict() if which else {}
    return plain({**config, "training": {**defaults, **training}})
