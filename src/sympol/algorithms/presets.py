"""Hyperparameters by environment, algorithm and policy: ours (``default``), the paper's (``paper``), with sources."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from .. import files
from ..bounded import LARGEST_BY_HAND, parse_toml
from .config import ConfigError
from .recipe import recipe

DEFAULT = "default"
ANY = "any"
"""The file of defaults for environments that have none of their own."""


def presets_of(env_name: str, policy: str = "tree", algorithm: str = "ppo") -> dict[str, dict[str, Any]]:
    """All presets of an environment by name; none for an environment without a file."""
    return _sections(env_name).get(algorithm, {}).get(policy, {})


def search_defaults(env_name: str) -> dict[str, Any]:
    """Return the defaults of ``sympol pareto`` for an environment, from the section ``[search]`` of its preset file.

    Returns:
        ``minutes`` (of the whole search), ``teachers`` (how many are trained) and ``shares`` (parts of the budget by
        method). What the environment's own file leaves out is that of any environment.
    """
    return {**_sections(ANY)["search"], **_sections(env_name).get("search", {})}


def _sections(env_name: str) -> dict[str, Any]:
    """Return the content of an environment's preset file, empty where it has none."""
    file = resources.files("sympol") / "presets" / f"{env_name.replace('/', '_')}.toml"
    return tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}


def preset(
    env_name: str,
    name: str = DEFAULT,
    *,
    policy: str = "tree",
    algorithm: str = "ppo",
    given: Mapping[str, Any] | None = None,
    from_tree: bool = False,
) -> dict[str, Any]:
    """Return the fields that a preset sets. An environment without a default has that of any environment.

    A name that ends in .toml or has a slash is the path of a file that holds the preset (`sympol tune`).

    Args:
        env_name: The id of the environment.
        name: The name of the preset.
        policy: The policy, as in ``Config.policy``.
        algorithm: The algorithm, as in ``Config.algorithm``.
        given: Fields that the user chose. The defaults of PPO for any environment follow the number of environment
            steps, and what else is chosen (`sympol.algorithms.recipe`), also for a tree with ``method="auto"`` where
            the environment has a preset.
        from_tree: Whether the training starts from a tree.

    Returns:
        Fields of a `Config` by name; not those that are given.

    Raises:
        ConfigError: There is no such preset.
    """
    if is_path(name):
        return _of_file(Path(name), policy, algorithm)
    presets = presets_of(env_name, policy, algorithm)
    if name == DEFAULT and (name not in presets or (given or {}).get("method") == "auto"):
        if algorithm == "ppo" and policy in ("tree", "mlp"):
            return recipe(given or {}, policy=policy, from_tree=from_tree)
        presets = presets_of(ANY, policy, algorithm)
    if name not in presets:
        if name == DEFAULT:
            return {}
        names = ", ".join(presets) or "none but the config's own defaults"
        raise ConfigError(f"{env_name} has no preset {name!r} for {algorithm} with {policy}; it has {names}")
    return {key: value for key, value in presets[name].items() if key != "source"}


def is_path(name: str) -> bool:
    """Return whether a preset is a file of the user's."""
    return name.endswith(".toml") or "/" in name or os.sep in name


def _of_file(path: Path, policy: str, algorithm: str) -> dict[str, Any]:
    """The preset that a file has for a policy and an algorithm; nothing in it is ever run as code."""
    try:
        content: Any = parse_toml(files.read_text(path), "it", most=LARGEST_BY_HAND)
    except OSError as error:
        raise ConfigError(
            f"cannot read the preset {path}: {error.strerror or error}; give the path of a .toml file, as sympol tune "
            "ENV --save-preset FILE writes it"
        ) from None
    except ValueError as error:  # not UTF-8, or not TOML
        raise ConfigError(f"the preset {path} is not TOML: {error}") from None
    names = {
        f"{a}.{p}.{n}" for a, of in _tables(content) for p, named in _tables(of) for n, _ in _tables(named)
    }
    wanted = f"{algorithm}.{policy}.{DEFAULT}"
    if wanted not in names:
        there = ", ".join(f"[{name}]" for name in sorted(names)) or "none such"
        raise ConfigError(
            f"the preset {path} has no section [{wanted}]; it has {there}; say --policy and --algorithm to match"
        )
    fields = {key: value for key, value in content[algorithm][policy][DEFAULT].items() if key != "source"}
    for name, value in {"algorithm": algorithm, "policy": policy}.items():
        if fields.pop(name, value) != value:
            raise ConfigError(f"the preset {path} has another {name} in its section [{wanted}]; leave it out")
    return fields


def _tables(content: Any) -> list[tuple[str, Any]]:
    return (
        [(k, v) for k, v in content.items() if isinstance(v, Mapping)] if isinstance(content, Mapping) else []
    )
