"""Environments by id: entries that users register, and adapters that answer for many ids."""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar, NamedTuple, TypeAlias

import gymnasium

from ..trees.groups import Group
from .capabilities import NativeEngine
from .env import Env
from .spec import HostFactory

Factory: TypeAlias = Callable[..., gymnasium.Env] | Callable[..., Env]


class Entry(NamedTuple):
    """The forms and names of one environment; parts that are None are those of Gymnasium's environment of this id."""

    env: Env | Factory | None = None
    """The environment in JAX, or a function that makes one or a Gymnasium environment."""
    host: HostFactory | None = None
    """A function that makes it in Gymnasium, to evaluate on and, without a form in JAX, to train on."""
    feature_names: Sequence[str] | None = None
    """Names of the features."""
    action_names: Sequence[str] | None = None
    """Names of the actions, or of the components of an action."""
    groups: Sequence[Group] | None = None
    """Features that are one-hot together."""
    native: NativeEngine | None = None
    """Machine code that does what the form in Gymnasium does without arguments, to the bit."""
    drawing: str = ""
    """The drawing that the report page makes of its observations; empty where it shows frames."""
    entry_points: tuple[str, ...] = ("gymnasium.envs.",)
    """How the entry point of this id begins in Gymnasium's registry. Where it begins otherwise, the id was registered
    anew, and the forms here are not used."""


class Adapter(abc.ABC):
    """A kind of environment, such as those of one package, found by how their ids begin.

    A subclass is made without arguments and listed in `sympol.envs.adapters.ADAPTERS`. Its module is imported when an
    id that begins like its own is first asked for; the package itself should wait until an environment is made.
    """

    registers: ClassVar[str] = ""
    """A module whose import registers more ids with Gymnasium, among which a mistyped one is searched."""

    @abc.abstractmethod
    def entry(self, env_id: str) -> Entry | None:
        """Describe an environment.

        Args:
            env_id: The id, which begins as in the table.

        Returns:
            The entry, or None for an id that a more general adapter answers for.
        """

    def ids(self) -> Iterable[str]:
        """List the ids that are suggested in place of a mistyped one, besides those in Gymnasium's registry.

        Returns:
            The ids.
        """
        return ()

    def adopt(self, env: Any) -> Env | None:
        """Take an object of the user's that has another protocol than `Env` and Gymnasium's.

        Args:
            env: The object.

        Returns:
            The same in the protocol of `Env`, or None where it is not of this kind, which is told without imports.
        """
        return None


REGISTERED: dict[str, Entry] = {}
"""What users registered with `sympol.register`."""
