"""Teachers of stable-baselines3, which is imported only here and only when asked for."""

from __future__ import annotations

import importlib
import json
import zipfile
from os import PathLike
from pathlib import Path
from typing import Any

from ..envs.spec import EnvSpec
from .teacher import Teacher

_MARKS = {
    "PPO": "clip_range",
    "DQN": "exploration_fraction",
    "SAC": "target_entropy",
    "TD3": "policy_delay",
    "A2C": "gae_lambda",
}
"""What each algorithm, and none after it, writes into its file; the file does not say its name.

DDPG is TD3 with other settings, all of which are in the file.
"""


def load_sb3(path: str | PathLike[str], spec: EnvSpec, *, trust: bool = False) -> Teacher:
    """Read a model that stable-baselines3 saved: PPO, A2C, DQN, SAC, TD3 or DDPG.

    What a model was trained through is not in its file: if its observations were normalised (``VecNormalize``) or
    stacked, make an environment that does the same, or give `Teacher.from_callable` a function that does.

    Args:
        path: The zip file, with or without its ending.
        spec: The environment it was trained on.
        trust: The file holds pickled objects, and unpickling runs whatever code its author put there. Say True for
            files of your own or of people you trust.

    Returns:
        The model as a teacher.

    Raises:
        ValueError: not trusted; no such model; or its spaces are not the environment's.
        FileNotFoundError: no such file.
        ImportError: stable-baselines3 is not installed.
    """
    file = _find(Path(path))
    data = _read(file)
    if not trust:
        raise ValueError(
            f"{file} holds pickled objects, and reading them runs any code that its author put there; if you trust "
            "it, say so: --trust (in Python, trust=True)"
        )
    name = _algorithm(file, data)
    try:
        sb3: Any = importlib.import_module("stable_baselines3")
    except ImportError as error:
        raise ImportError(
            "a stable-baselines3 model needs a package that is not installed; install it: pip install 'sympol[sb3]'"
        ) from error
    try:
        model = getattr(sb3, name).load(file, device="cpu")
    except Exception as error:  # unpickling may raise anything at all
        raise ValueError(
            f"{file} looks like a {name} model, but stable-baselines3 {sb3.__version__} cannot load it: {error}; load "
            "it yourself and give Teacher.from_model the model"
        ) from error
    return Teacher.from_model(model, spec)


def _find(path: Path) -> Path:
    """The file, to which stable-baselines3 adds its ending by itself."""
    for file in (path, path.with_name(path.name + ".zip")):
        if file.is_file():
            return file
    raise FileNotFoundError(f"there is no file {path}; give the zip that model.save(...) wrote")


def _read(file: Path) -> dict[str, Any]:
    """The part of the file that is plain JSON; nothing in it is unpickled."""
    try:
        with zipfile.ZipFile(file) as archive:
            data = json.loads(archive.read("data"))
    except (zipfile.BadZipFile, KeyError, ValueError, NotImplementedError, RuntimeError) as error:
        raise ValueError(
            f"{file} is not a model of stable-baselines3 ({error}); give the zip that model.save(...) wrote"
        ) from error
    if not isinstance(data, dict):
        raise ValueError(
            f"{file} is not a model of stable-baselines3; give the zip that model.save(...) wrote"
        )
    return data


def _algorithm(file: Path, data: dict[str, Any]) -> str:
    policy = data.get("policy_class")
    module = policy.get("__module__", "") if isinstance(policy, dict) else ""
    name = next((name for name, mark in _MARKS.items() if mark in data), None)
    if name is None or str(module).startswith("sb3_contrib"):
        raise ValueError(
            f"{file} must be a model of {', '.join(_MARKS)} or DDPG, got one with a policy of {module or 'no module'}; "
            "load it yourself and give Teacher.from_model the model"
        )
    return name
