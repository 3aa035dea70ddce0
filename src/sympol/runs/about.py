"""What a run is of, as its `config.toml` says it: written, and read with care."""

from __future__ import annotations

import reprlib
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium
import tomli_w

from .. import __version__, files
from ..algorithms.config import Config, ConfigError
from ..bounded import parse_toml
from ..envs.origin import Origin
from ..envs.spec import EnvSpec
from ..provenance import versions
from ..trees import Group

CONFIG = "config.toml"
FORMAT = 1
_ABOUT = {
    "sympol": str,
    "env": str,
    "backend": str,
    "seed": int,
    "preset": str,
    "eval_episodes": int,
    "feature_names": list,
    "action_names": list,
    "env_kwargs": dict,
    "wrappers": list,
    "not_kept": str,
    "groups": list,
    "distilled": dict,
    "start": dict,
}
_LATER: dict[str, Any] = {
    "eval_episodes": 20,
    "env_kwargs": {},
    "wrappers": [],
    "not_kept": "",
    "groups": [],
    "distilled": {},
    "start": {},
}
"""What runs may lack, and what it was when they were made."""
_QUOTES = "'\""
_LONGEST = 300
_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = 80
_RANGES = {"seed": (0, 2**32 - 1), "eval_episodes": (1, 2**31)}


def file_name(name: str) -> str:
    """What something is called, an environment's id say, as the name of a file or a folder."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name)


class RunError(RuntimeError):
    """A run's folder that cannot be made, read or continued; the message says what to do."""


class WriteError(RunError):
    """A file of a run that cannot be written, as on a full disk; the message names it and says how to go on."""


def short(value: object) -> str:
    """A value from a file as a part of an error message: not too long, and without control characters."""
    return _REPR.repr(value)


def describe(
    spec: EnvSpec,
    seed: int,
    preset: str,
    eval_episodes: int,
    distilled: Mapping[str, Any],
    start: Mapping[str, Any],
) -> dict[str, Any]:
    """The table ``[run]``."""
    return {
        "format": FORMAT,
        "sympol": __version__,
        "env": spec.name,
        "backend": spec.backend,
        "seed": seed,
        "preset": preset,
        "eval_episodes": eval_episodes,
        "feature_names": list(spec.features.names),
        "action_names": list(spec.actions.names),
        **spec.origin.to_dict(),
        "groups": [_group_to_toml(group) for group in spec.features.groups],
        "distilled": dict(distilled),
        "start": dict(start),
    }


def to_toml(about: Mapping[str, Any], config: Mapping[str, Any]) -> str:
    """The file."""
    written = {name: value for name, value in about.items() if value != _LATER.get(name)}
    return tomli_w.dumps({"run": written, "config": config, "versions": versions()})


def read(path: Path) -> tuple[dict[str, Any], Config]:
    """What the run in the folder ``path`` is of, and its config.

    Raises:
        RunError: there is no run, or it has another format.
    """
    file = path / CONFIG
    try:
        content = parse_toml(files.read_text(file), "it")
        about, config = content["run"], content["config"]
    except (FileNotFoundError, NotADirectoryError) as error:
        raise RunError(f"there is no run in {path}: it has no {CONFIG}") from error
    except KeyError as error:
        raise RunError(f"{file} is not a run's: it lacks [{error.args[0]}]") from error
    except (OSError, ValueError) as error:
        raise RunError(f"{file} cannot be read: {error}") from error
    if not isinstance(about, dict) or not isinstance(config, dict):
        raise RunError(f"{file} is not a run's: [run] and [config] must be tables")
    if type(about.get("format")) is not int or about["format"] != FORMAT:
        made_by, other = short(about.get("sympol", "?")).strip(_QUOTES), short(about.get("format"))
        raise RunError(
            f"{path} was made by sympol {made_by} in format {other}; this is "
            f"sympol {__version__}, which reads format {FORMAT}: install the version that made it"
        )
    for name, kind in _ABOUT.items():
        value = about.setdefault(name, _LATER[name]) if name in _LATER else about.get(name)
        parts = value if name.endswith("_names") and isinstance(value, list) else ["none"]
        if type(value) is not kind or not all(isinstance(part, str) for part in parts):
            raise RunError(f"{file}: {name} must be a {kind.__name__}, got {short(value)}")
    for name, (low, high) in _RANGES.items():
        if not low <= about[name] <= high:
            raise RunError(f"{file}: {name} must be between {low} and {high}, got {short(about[name])}")
    try:
        about["groups"] = [Group(**group) for group in about["groups"]]
        Origin.from_dict(about)
        return about, Config.from_dict(config)
    except (ConfigError, TypeError, ValueError, OverflowError) as error:
        raise RunError(f"{file}: {str(error)[:_LONGEST]}") from error


_RUNS_A_MODULE = ("GymV21Environment-v0", "GymV26Environment-v0")
"""Ids of Gymnasium that import whatever module their arguments name."""


def require_no_import(env: str, path: Path, *, trust: bool = False) -> None:
    """Refuse an environment's id, as a file names it, that would have a module imported.

    Args:
        env: The id, such as ``"my_package:Tank-v0"``.
        path: The folder or file that names it.
        trust: Whether its module may be imported nevertheless.

    Raises:
        RunError: The module is not imported yet, and importing it would run its code.
    """
    module, _, env_id = env.rpartition(":")
    if trust or (env_id not in _RUNS_A_MODULE and (not module or _is_from(module, env_id))):
        return
    raise RunError(
        f"{path} names the environment {env!r}, which needs a module; folders and files have no module imported, "
        f"because that runs its code: if you trust it, say --trust, or name it yourself with --env {env} (in Python, "
        f"env={env!r})"
    )


def _is_from(module: str, env_id: str) -> bool:
    """Whether a module is imported already and has registered an environment of its own by this id."""
    spec = gymnasium.registry.get(env_id)
    if spec is None or module not in sys.modules:
        return False
    entry = spec.entry_point
    home = entry.partition(":")[0] if isinstance(entry, str) else getattr(entry, "__module__", "")
    return home.partition(".")[0] == module.partition(".")[0]


def is_run(config_file: Path) -> bool:
    """Whether this is the config of a run of ours, and not one of the many other files of that name."""
    try:
        about = parse_toml(files.read_text(config_file), "it").get("run")
    except (OSError, ValueError):
        return False
    return isinstance(about, dict) and {"format", "sympol"} <= about.keys()


def _group_to_toml(group: Group) -> dict[str, Any]:
    return {name: value for name, value in asdict(group).items() if value is not None}
