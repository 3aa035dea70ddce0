"""Environments of Gymnasium by id, those of other packages by ``module:id``."""

from __future__ import annotations

import difflib
import importlib
import warnings
from collections.abc import Mapping
from functools import partial
from typing import Any

import gymnasium

from ..entries import REGISTERED, Adapter, Entry
from ..errors import EnvironmentFailure, MissingExtra, UnknownEnvironment
from . import all_ids, import_for

_EXTRAS = ("box2d",)
"""Extras of sympol's that have the name by which Gymnasium's messages call the package."""


class Gymnasium(Adapter):
    """Every id that Gymnasium knows."""

    def entry(self, env_id: str) -> Entry:
        """See `Adapter.entry`."""
        return Entry(host=partial(make, env_id))


def make(env_id: str, **kwargs: Any) -> gymnasium.Env:
    """Make an environment as `gymnasium.make` does.

    Args:
        env_id: The id, or ``module:id`` where importing a module registers it.
        kwargs: The arguments of `gymnasium.make`.

    Returns:
        The environment.

    Raises:
        UnknownEnvironment: No environment has this id.
        MissingExtra: It needs a package that is not installed.
        EnvironmentFailure: It raised an error.
        TypeError: It does not take the arguments.
    """
    name = require_known(env_id)
    # the checker would repeat its warnings for every copy; what cannot be trained on, HostEnvs refuses
    try:
        with warnings.catch_warnings():
            # Box2D's SWIG warns at its import, and crashes the process where warnings are errors
            warnings.filterwarnings("ignore", r"builtin type \w+ has no __module__", DeprecationWarning)
            return gymnasium.make(name, disable_env_checker=True, **kwargs)
    except (TypeError, MissingExtra):
        raise
    except gymnasium.error.DependencyNotInstalled as error:
        hint = next(
            (f"install it: pip install 'sympol[{extra}]'" for extra in _EXTRAS if extra in str(error)), ""
        )
        raise MissingExtra(f"{env_id} needs a package that is not installed; {hint} ({error})") from error
    except gymnasium.error.Error:
        raise
    except Exception as error:
        raise EnvironmentFailure(f"{env_id} cannot be made{_with(kwargs)}: {_in_words(error)}") from error


def require_known(env_id: str) -> str:
    """Return the id without its module, once that is imported.

    Args:
        env_id: The id, or ``module:id``.

    Returns:
        The id in Gymnasium's registry.

    Raises:
        UnknownEnvironment: No environment has this id, or there is no such module; with near ids.
        ImportError: The module is there, but importing it failed.
    """
    module, _, name = env_id.rpartition(":")
    import_for(name)
    try:
        if module:
            import_named(module)
        gymnasium.spec(name)
    except gymnasium.error.Error as error:
        known = {known.lower(): known for known in (*REGISTERED, *all_ids(), *gymnasium.registry)}
        near = [repr(known[match]) for match in difflib.get_close_matches(name.lower(), known)]
        hint = f"did you mean {' or '.join(near)}?" if near else "nothing known has a similar name."
        raise UnknownEnvironment(
            f"unknown environment {env_id!r}: {hint} An id of another package needs its module before "
            f"it, as in 'module:Name-v0'. ({error})"
        ) from error
    return name


def import_named(module: str) -> None:
    """Import the module that a user named, for the environments that it registers.

    Args:
        module: Its name.

    Raises:
        UnknownEnvironment: There is no such module.
        MissingExtra: It needs a package that is not installed.
        ImportError: Importing it failed.
    """
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if module == missing or module.startswith(f"{missing}."):
            raise UnknownEnvironment(
                f"unknown environment: there is no module {missing}; is its folder on PYTHONPATH? ({error})"
            ) from error
        raise MissingExtra(
            f"module {module} was found, but needs {missing}, which is not installed; install it"
        ) from error
    except (Exception, SystemExit) as error:
        raise ImportError(
            f"module {module} was found, but importing it failed: {_in_words(error)}"
        ) from error


def _in_words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".removesuffix(": ")


def _with(kwargs: Mapping[str, Any]) -> str:
    return f" with {', '.join(f'{name}={value!r}' for name, value in kwargs.items())}" if kwargs else ""
