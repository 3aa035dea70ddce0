"""The origin of an environment: how it was made, as far as a run's folder can keep it.

This is data only, so that reading it needs no Gymnasium.

`sympol.envs.remake` describes environments in this form and makes them again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from .arguments import CannotKeep, from_plain, to_plain


class Wrapping(NamedTuple):
    """A wrapper, one of `sympol.envs.remake.KEPT_WRAPPERS`, with its arguments.

    Attributes:
        name: The name of the class.
        kwargs: The arguments.
    """

    name: str
    kwargs: Mapping[str, Any]


@dataclass(frozen=True)
class Origin:
    """The arguments and wrappers that an environment was made with, besides its id.

    Args:
        env_kwargs: Arguments of `gymnasium.make`, or of the function that makes it.
        wrappers: Wrappers around it, from the innermost to the outermost.
        not_kept: Why id, arguments and wrappers do not make this environment again; empty where they do.
        file: The absolute path of the file that an id such as ``tank.py:Tank`` names; empty for others.
    """

    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    wrappers: tuple[Wrapping, ...] = ()
    not_kept: str = ""
    file: str = ""

    @property
    def is_as_registered(self) -> bool:
        """True where the id alone makes this environment."""
        return not (self.env_kwargs or self.wrappers or self.not_kept)

    def to_dict(self) -> dict[str, Any]:
        """Return the origin as TOML and JSON can hold it.

        Returns:
            A dictionary of ``env_kwargs``, ``wrappers``, ``not_kept`` and ``file``.
        """
        if self.not_kept:
            return {"env_kwargs": {}, "wrappers": [], "not_kept": self.not_kept, "file": self.file}
        wrappers = [{"name": w.name, "kwargs": to_plain(dict(w.kwargs), w.name)} for w in self.wrappers]
        return {
            "env_kwargs": to_plain(dict(self.env_kwargs), "env_kwargs"),
            "wrappers": wrappers,
            "not_kept": "",
            "file": self.file,
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Origin:
        """Read what `to_dict` returned.

        Args:
            content: The dictionary; parts that are missing are empty.

        Returns:
            The origin.

        Raises:
            ValueError: It has another form.
        """
        kwargs, wrappers = content.get("env_kwargs", {}), content.get("wrappers", [])
        if not isinstance(kwargs, dict):
            raise ValueError(f"env_kwargs must be a table, got {kwargs!r}")
        if not isinstance(wrappers, list):
            raise ValueError(f"wrappers must be a list, got {wrappers!r}")
        for wrapper in wrappers:
            if not isinstance(wrapper, dict) or not (
                isinstance(wrapper.get("name"), str) and isinstance(wrapper.get("kwargs"), dict)
            ):
                raise ValueError(f"wrappers must be tables of name and kwargs, got {wrapper!r}")
        read = tuple(Wrapping(w["name"], from_plain(w["kwargs"])) for w in wrappers)
        return cls(from_plain(kwargs), read, str(content.get("not_kept", "")), str(content.get("file", "")))

    @classmethod
    def of_arguments(
        cls, env_kwargs: Mapping[str, Any], wrappers: tuple[Wrapping, ...] = (), file: str = ""
    ) -> Origin:
        """Describe an environment that was made by its id.

        Args:
            env_kwargs: The arguments.
            wrappers: The wrappers around it, from the innermost, of `KEPT_WRAPPERS`.
            file: The file that the id names, if it names one.

        Returns:
            The origin.
        """
        try:
            to_plain(dict(env_kwargs), "env_kwargs")
        except CannotKeep as problem:
            return cls(env_kwargs, wrappers, f"with an argument that a folder cannot keep: {problem}", file)
        return cls(env_kwargs, wrappers, file=file)
