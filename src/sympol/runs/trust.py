"""Code that a run's folder or a tree's file names: it is run only at the word of the user."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from ..envs.libraries import is_library_id
from ..envs.user_code import is_file, loaded_from, location
from .metadata import RunError

_RUNS_A_MODULE = ("GymV21Environment-v0", "GymV26Environment-v0")
"""Ids of Gymnasium that import whatever module their arguments name."""


def trusted_id(env: str, path: Path, *, trust: bool = False, file: str = "") -> str:
    """Return the id of an environment that a folder or a file names, as far as making it may run code.

    Args:
        env: The id, such as ``"CartPole-v1"``, ``"my_package:Tank-v0"`` or ``"tank.py:Tank"``.
        path: The run's folder or the file that names it.
        trust: Whether its module or file may be imported.
        file: The path of the file that the id means, where the folder keeps it.

    Returns:
        The id, with the path of its file.

    Raises:
        RunError: Code would have to be imported and ``trust`` is not given, it lies in the same folder, or its file
            is not there.
    """
    if is_library_id(env):
        return env
    module, _, env_id = env.rpartition(":")
    in_file = is_file(module)
    if in_file and os.path.isabs(file) and os.path.basename(file) == os.path.basename(module):
        module = file
    exact = f"{module}:{env_id}" if in_file else env
    if env_id not in _RUNS_A_MODULE and (not module or _is_loaded(module, env_id)):
        return exact
    if not trust:
        needed = f"code of the file {module}" if in_file else "a module"
        raise RunError(
            f"{path} names the environment {env!r}, which needs {needed}; folders and files have no code imported, "
            f"because that runs it: if you trust it, import it first with sympol --import {module or 'MODULE'} "
            f"COMMAND, or say --trust or --env {exact} where the command has these flags (in Python, env={exact!r})"
        )
    found, folder = location(module), path.resolve() if path.is_dir() else path.resolve().parent
    if found is not None and found.is_relative_to(folder):
        raise RunError(
            f"{path} names the environment {env!r}, whose code lies in the same folder, {found}, and is not trusted "
            f"with it; read it, and name it yourself: --env {exact}"
        )
    if in_file and not os.path.isfile(module):
        raise RunError(
            f"{path} needs the file {os.path.basename(module)} for its environment {env!r}, which is not there "
            f"({module}); say where it is now: --env path/to/{os.path.basename(module)}:{env_id} (in Python, env=...)"
        )
    return exact


def needs_trust(env: str) -> bool:
    """Return whether an environment is made by code of a user's, which a folder's word alone does not have imported.

    Args:
        env: The id, as a folder keeps it.

    Returns:
        True for ``module:name`` and ``file.py:name``.
    """
    return ":" in env and not is_library_id(env)


def _is_loaded(module: str, env_id: str) -> bool:
    """Return whether code is imported already and has an environment of its own by this name."""
    loaded = loaded_from(Path(module)) if is_file(module) else sys.modules.get(module)
    if loaded is None:
        return False
    made = getattr(loaded, env_id, None)
    if isinstance(made, type):
        return made.__module__ == loaded.__name__ and hasattr(made, "reset") and hasattr(made, "step")
    import gymnasium

    if (spec := gymnasium.registry.get(env_id)) is None:
        return False
    entry = spec.entry_point
    home = entry.partition(":")[0] if isinstance(entry, str) else getattr(entry, "__module__", "")
    return home.partition(".")[0] == loaded.__name__.partition(".")[0]
