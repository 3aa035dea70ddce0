"""Environments of Gymnasium by id, those of other packages by ``module:id``."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Mapping
from functools import partial
from typing import Any

import gymnasium

from ..entries import REGISTERED, Adapter, Entry
from ..errors import EnvironmentFailure, MissingExtra, UnknownEnvironment
from ..named import import_named
from ..user_code import in_words, split
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
        env_id: The id, or ``module:id`` or ``file.py:id`` where importing a module or a file registers it.
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
        raise EnvironmentFailure(f"{env_id} cannot be made{_with(kwargs)}: {in_words(error)}") from error


def require_known(env_id: str) -> str:
    """Return the id without its module, once that is imported.

    Args:
        env_id: The id, ``module:id`` or ``file.py:id``.

    Returns:
        The id in Gymnasium's registry.

    Raises:
        UnknownEnvironment: No environment has this id, or there is no such module; with near ids.
        ImportError: The module is there, but importing it failed.
    """
    module, name = split(env_id)
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
            f"it, as in 'module:Name-v0', and what is in a file needs the file, as in 'file.py:Name'. ({error})"
        ) from error
    return name


def _with(kwargs: Mapping[str, Any]) -> str:
    return f" with {', '.join(f'{name}={value!r}' for name, value in kwargs.items())}" if kwargs else ""
