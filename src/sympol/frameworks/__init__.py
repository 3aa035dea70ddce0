"""The tree inside other frameworks, each an extra: stable-baselines3, that is PyTorch, is ``sympol[sb3]``."""

from importlib import import_module

try:
    for _package in ("torch", "stable_baselines3"):
        import_module(_package)
except ImportError as error:
    raise ImportError(
        "sympol.frameworks needs packages that are not installed; install them: pip install 'sympol[sb3]'"
    ) from error

from .sb3 import TreePolicy
from .scaling import warm_up
from .torch_tree import hard_tree

__all__ = ["TreePolicy", "hard_tree", "warm_up"]
