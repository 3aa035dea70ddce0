"""What a run is of, as its `config.toml` says it: written, and read with care."""

from __future__ import annotations

import platform
import reprlib
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import tomli_w

from .. import __version__, files
from ..algos.config import Config, ConfigError
from ..envs import native
from ..envs.spec import EnvSpec
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
    "groups": list,
    "distilled": dict,
    "start": dict,
}
_LATER: dict[str, Any] = {"eval_episodes": 20, "env_kwargs": {}, "groups": [], "distilled": {}, "start": {}}
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
        "env_kwargs": dict(spec.env_kwargs),
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
        content = files.parse_toml(files.read_text(file, files.MOST))
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
        return about, Config.from_dict(config)
    except (ConfigError, TypeError, ValueError, OverflowError) as error:
        raise RunError(f"{file}: {str(error)[:_LONGEST]}") from error


def is_run(config_file: Path) -> bool:
    """Whether this is the config of a run of ours, and not one of the many other files of that name."""
    try:
        about = files.parse_toml(files.read_text(config_file, files.MOST)).get("run")
    except (OSError, ValueError):
        return False
    return isinstance(about, dict) and {"format", "sympol"} <= about.keys()


def _group_to_toml(group: Group) -> dict[str, Any]:
    return {name: value for name, value in asdict(group).items() if value is not None}


def versions() -> dict[str, str]:
    """Of everything that a result may depend on."""
    found = {"python": platform.python_version(), "sympol": __version__}
    some = ("numba",) if native.is_installed() else ()
    for package in ("jax", "jaxlib", "equinox", "optax", "gymnasium", "numpy", *some):
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # pragma: no cover
            found[package] = "?"
    return found
