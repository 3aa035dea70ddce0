"""A tree in other languages and formats: one file each, `FORMATS` lists them all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, final

from ..tree import DecisionTree


@final
@dataclass(frozen=True)
class Format:
    """One thing a tree can be written as."""

    title: str
    """What it is, for people: ``"Python, without dependencies"``."""
    suffix: str
    """Of its files, with the dot."""
    where: str
    """``"module:function"``, relative to `sympol.trees`; imported on first use."""
    binary: bool = False
    """Whether what is written is bytes."""

    def write(self, tree: DecisionTree, **options: Any) -> str | bytes:
        """Write the tree. Raises ImportError, saying what to install, where a library is lacking."""
        module, function = self.where.split(":")
        return getattr(import_module(f"..{module}", __package__), function)(tree, **options)


FORMATS: Mapping[str, Format] = {
    "python": Format("Python, without dependencies", ".py", "export.python:to_python"),
    "json": Format("JSON, read again by DecisionTree.from_json", ".json", "serialize:to_json"),
    "text": Format("text, for people", ".txt", "text:to_text"),
}


def format_of(name: str) -> Format:
    """The format of a name. Raises ValueError, naming all."""
    if name not in FORMATS:
        raise ValueError(f"unknown format {name!r}; there are {', '.join(FORMATS)}")
    return FORMATS[name]
