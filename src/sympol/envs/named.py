"""Environments that are classes, functions or objects of the user's: ``tank.py:Tank``, ``my_package:make_tank``."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .errors import EnvironmentFailure, UnknownEnvironment
from .user_code import CodeNotFound, find, import_code, in_words, short


def import_named(module: str) -> None:
    """Import the module or the file that a user named, for the environments in it.

    Args:
        module: Its name, or the path of the file.

    Raises:
        UnknownEnvironment: There is no such module or file.
        MissingExtra: It needs a package that is not installed.
        ImportError: Importing it failed.
    """
    try:
        import_code(module)
    except CodeNotFound as error:
        raise UnknownEnvironment(f"unknown environment: {error}") from error


@dataclass(frozen=True)
class NamedEnv:
    """A function that makes an environment by the name of its class or function.

    It can be sent to another process, which imports the code itself.

    Args:
        module: The module, or the absolute path of its file.
        name: The name in it.
    """

    module: str
    name: str

    def __str__(self) -> str:
        """Return the name as it is shown."""
        return short(f"{self.module}:{self.name}")

    def __call__(self, **kwargs: Any) -> Any:
        """Make an environment.

        Args:
            kwargs: The arguments of the class or function.

        Returns:
            The environment.

        Raises:
            UnknownEnvironment: The name is gone, or what it names makes no environment.
            ValueError: The arguments do not fit.
            EnvironmentFailure: It raised an error.
        """
        make = self.find()
        _require_fitting(make, str(self), kwargs)
        try:
            made = make(**kwargs)
        except (Exception, SystemExit) as error:
            given = f" with {', '.join(f'{k}={v!r}' for k, v in kwargs.items())}" if kwargs else ""
            raise EnvironmentFailure(f"{self} cannot be made{given}: {in_words(error)}") from error
        if not _is_environment(made):
            raise UnknownEnvironment(
                f"{self} must make an environment, which has reset and step, but it made {made!r:.80}"
            )
        return made

    def find(self) -> Any:
        """Return the class, the function or the object itself.

        Returns:
            What has the name.

        Raises:
            UnknownEnvironment: There is none, or it is no environment and makes none.
            ImportError: Importing the code failed.
        """
        try:
            found = find(self.module, self.name)
        except CodeNotFound as error:
            raise UnknownEnvironment(f"unknown environment {str(self)!r}: {error}") from error
        if _is_environment(found) or callable(found):
            return found
        raise UnknownEnvironment(
            f"{self} is no environment: it is {found!r:.80}; name a class of environments, a function that makes "
            "one, or an environment"
        )


def named_env(module: str, name: str) -> Any:
    """Return an environment of the user's, or a function that makes it.

    Args:
        module: The module, or the absolute path of its file.
        name: The name in it of a class, a function or an object.

    Returns:
        The object if it is an environment, else a `NamedEnv`.

    Raises:
        UnknownEnvironment: There is no such environment.
        ImportError: Importing the code failed.
    """
    named = NamedEnv(module, name)
    found = named.find()
    return found if _is_environment(found) and not isinstance(found, type) else named


def _is_environment(value: object) -> bool:
    return not inspect.ismodule(value) and hasattr(value, "reset") and hasattr(value, "step")


def _require_fitting(make: Any, name: str, kwargs: Mapping[str, Any]) -> None:
    """Raise ValueError where a class or function does not take the arguments, or needs others."""
    try:
        signature = inspect.signature(make)
    except (TypeError, ValueError):  # some built-in ones have none
        return
    try:
        signature.bind(**kwargs)
    except TypeError as error:
        kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
        takes = [p for p in signature.parameters.values() if p.kind in kinds]
        missing = [p.name for p in takes if p.default is p.empty and p.name not in kwargs]
        if missing:
            flags = " ".join(f"{name}=VALUE" for name in [*kwargs, *missing])
            raise ValueError(
                f"{name} needs {' and '.join(missing)}: --env-kwargs {flags} (in Python, env_kwargs)"
            ) from error
        does = f"takes {', '.join(p.name for p in takes)}" if takes else "takes no arguments"
        raise ValueError(f"{name} {does}, got env_kwargs {dict(kwargs)}: {error}") from error
