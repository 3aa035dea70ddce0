"""Hyperparameters by environment and policy: ours (``default``) and the paper's (``paper``), each with its source."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Any

from .config import ConfigError

DEFAULT = "default"


def presets_of(env_name: str, policy: str = "tree") -> dict[str, dict[str, Any]]:
    """All presets of an environment by name; none for an environment without a file."""
    file = files("sympol") / "presets" / f"{env_name.replace('/', '_')}.toml"
    return tomllib.loads(file.read_text(encoding="utf-8")).get(policy, {}) if file.is_file() else {}


def preset(env_name: str, name: str = DEFAULT) -> dict[str, Any]:
    """The fields that a preset sets. An environment without a default has the config's own defaults."""
    presets = presets_of(env_name)
    if name not in presets:
        if name == DEFAULT:
            return {}
        names = ", ".join(presets) or "none but the config's own defaults"
        raise ConfigError(f"{env_name} has no preset {name!r}; it has {names}")
    return {key: value for key, value in presets[name].items() if key != "source"}
