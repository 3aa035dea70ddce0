"""Hyperparameters by environment, algorithm and policy: ours (``default``), the paper's (``paper``), with sources."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Any

from .config import ConfigError

DEFAULT = "default"
ANY = "any"
"""The file of defaults for environments that have none of their own."""


def presets_of(env_name: str, policy: str = "tree", algorithm: str = "ppo") -> dict[str, dict[str, Any]]:
    """All presets of an environment by name; none for an environment without a file."""
    file = files("sympol") / "presets" / f"{env_name.replace('/', '_')}.toml"
    sections = tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    return sections.get(algorithm, {}).get(policy, {})


def preset(
    env_name: str, name: str = DEFAULT, *, policy: str = "tree", algorithm: str = "ppo"
) -> dict[str, Any]:
    """The fields that a preset sets. An environment without a default has that of any environment."""
    presets = presets_of(env_name, policy, algorithm)
    if name == DEFAULT:
        presets = {**presets_of(ANY, policy, algorithm), **presets}
    if name not in presets:
        if name == DEFAULT:
            return {}
        names = ", ".join(presets) or "none but the config's own defaults"
        raise ConfigError(f"{env_name} has no preset {name!r} for {algorithm} with {policy}; it has {names}")
    return {key: value for key, value in presets[name].items() if key != "source"}
