"""A run's `config.toml`: its metadata (the table `[run]`), hyperparameters and versions, read with care."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from .. import files
from ..algorithms.config import Config, ConfigError
from ..bounded import parse_toml
from ..envs.origin import Origin
from ..provenance import versions
from ..trees.groups import Group
from ..version import __version__

if TYPE_CHECKING:
    from ..envs.spec import EnvSpec

CONFIG = "config.toml"
FORMAT = 1
_TYPES = {
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
    "file": str,
    "groups": list,
    "spaces": dict,
    "distilled": dict,
    "start": dict,
}
_OPTIONAL: dict[str, Any] = {
    "eval_episodes": 20,
    "env_kwargs": {},
    "wrappers": [],
    "not_kept": "",
    "file": "",
    "groups": [],
    "spaces": {},
    "distilled": {},
    "start": {},
}
"""Fields that a run may lack, and their values where they are missing."""
_QUOTES = "'\""
_LONGEST = 300
_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = 80
_RANGES = {"seed": (0, 2**32 - 1), "eval_episodes": (1, 2**31)}


def file_name(name: str) -> str:
    """Return a name, such as an environment's id, as the name of a file or a folder."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name)


class RunError(RuntimeError):
    """A run's folder that cannot be made, read or resumed; the message names the remedy."""


class WriteError(RunError):
    """A file of a run that cannot be written, as on a full disk; the message names it and the remedy."""


def short(value: object) -> str:
    """Return a value from a file as a part of an error message: short, and without control characters."""
    return _REPR.repr(value)


def describe(
    spec: EnvSpec,
    seed: int,
    preset: str,
    eval_episodes: int,
    distilled: Mapping[str, Any],
    start: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the metadata of a new run, the table ``[run]``.

    Args:
        spec: The environment.
        seed: The training's seed.
        preset: The preset that the hyperparameters are from.
        eval_episodes: Number of test episodes at the end.
        distilled: For a distilled tree, the method, its options and the teacher; else empty.
        start: For a training that starts from a tree, where it is from and how to start; else empty.
    """
    from ..envs.recorded import record  # and with it Gymnasium

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
        "spaces": record(spec),
        "distilled": dict(distilled),
        "start": dict(start),
    }


def to_toml(metadata: Mapping[str, Any], config: Mapping[str, Any]) -> str:
    """Return the text of ``config.toml``.

    Args:
        metadata: The table ``[run]``.
        config: The table ``[config]``, empty for a distilled tree.
    """
    written = {name: value for name, value in metadata.items() if value != _OPTIONAL.get(name)}
    return tomli_w.dumps({"run": written, "config": config, "versions": versions()})


def read(path: Path) -> tuple[dict[str, Any], Config]:
    """Read ``config.toml``.

    Args:
        path: The run's folder.

    Returns:
        The run's metadata, whose fields have the right types, and its hyperparameters.

    Raises:
        RunError: There is no run, or it has another format.
    """
    file = path / CONFIG
    try:
        content = parse_toml(files.read_text(file), "it")
        metadata, config = content["run"], content["config"]
    except (FileNotFoundError, NotADirectoryError) as error:
        raise RunError(f"there is no run in {path}: it has no {CONFIG}") from error
    except KeyError as error:
        raise RunError(f"{file} is not a run's: it lacks [{error.args[0]}]") from error
    except (OSError, ValueError) as error:
        raise RunError(f"{file} cannot be read: {error}") from error
    if not isinstance(metadata, dict) or not isinstance(config, dict):
        raise RunError(f"{file} is not a run's: [run] and [config] must be tables")
    if type(metadata.get("format")) is not int or metadata["format"] != FORMAT:
        made_by, other = short(metadata.get("sympol", "?")).strip(_QUOTES), short(metadata.get("format"))
        raise RunError(
            f"{path} was made by sympol {made_by} in format {other}; this is "
            f"sympol {__version__}, which reads format {FORMAT}: install the version that made it"
        )
    for name, kind in _TYPES.items():
        value = metadata.setdefault(name, _OPTIONAL[name]) if name in _OPTIONAL else metadata.get(name)
        parts = value if name.endswith("_names") and isinstance(value, list) else ["none"]
        if type(value) is not kind or not all(isinstance(part, str) for part in parts):
            raise RunError(f"{file}: {name} must be a {kind.__name__}, got {short(value)}")
    for name, (low, high) in _RANGES.items():
        if not low <= metadata[name] <= high:
            raise RunError(f"{file}: {name} must be between {low} and {high}, got {short(metadata[name])}")
    try:
        metadata["groups"] = [Group(**group) for group in metadata["groups"]]
        Origin.from_dict(metadata)
        return metadata, Config.from_dict(config)
    except (ConfigError, TypeError, ValueError, OverflowError) as error:
        raise RunError(f"{file}: {str(error)[:_LONGEST]}") from error


def is_run(config_file: Path) -> bool:
    """Return whether a ``config.toml`` is a run's, and not one of the many other files of that name."""
    try:
        metadata = parse_toml(files.read_text(config_file), "it").get("run")
    except (OSError, ValueError):
        return False
    return isinstance(metadata, dict) and {"format", "sympol"} <= metadata.keys()


def _group_to_toml(group: Group) -> dict[str, Any]:
    return {name: value for name, value in asdict(group).items() if value is not None}
