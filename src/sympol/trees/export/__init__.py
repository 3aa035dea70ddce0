"""A tree in other languages and formats: one file each, `FORMATS` lists them all."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, final

from ..base import BaseTree


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
    also: tuple[str, ...] = ()
    """Other suffixes that such files have."""

    @property
    def suffixes(self) -> tuple[str, ...]:
        """All suffixes of its files, the usual one first."""
        return (self.suffix, *self.also)

    def write(self, tree: BaseTree, **options: Any) -> str | bytes:
        """Write the tree. Raises ImportError, saying what to install, where a library is lacking."""
        return self._function(tree, **options)

    @property
    def options(self) -> tuple[str, ...]:
        """What `write` may be told, besides the tree."""
        return tuple(inspect.signature(self._function).parameters)[1:]

    @property
    def _function(self) -> Callable[..., str | bytes]:
        module, function = self.where.split(":")
        return getattr(import_module(f"..{module}", __package__), function)


FORMATS: Mapping[str, Format] = {
    "python": Format("Python, without dependencies", ".py", "export.python:to_python"),
    "c": Format("C99, no allocation, no library", ".c", "export.c:to_c"),
    "c-header": Format("the header of the C file", ".h", "export.c:to_c_header", also=(".hpp", ".hh")),
    "rust": Format("Rust, no_std, no dependencies", ".rs", "export.rust:to_rust"),
    "javascript": Format(
        "JavaScript, an ES module", ".js", "export.javascript:to_javascript", also=(".mjs",)
    ),
    "sql": Format("SQL, a query of PostgreSQL or SQLite", ".sql", "export.sql:to_sql"),
    "onnx": Format("ONNX, for onnxruntime", ".onnx", "export.onnx:to_onnx", binary=True),
    "treelite": Format("a Treelite model", ".treelite", "export.treelite:to_treelite", binary=True),
    "json": Format("JSON, read again by DecisionTree.from_json", ".json", "serialize:to_json"),
    "text": Format("text, for people", ".txt", "text:to_text"),
    "markdown": Format(
        "a Markdown table of rules", ".md", "export.markdown:to_markdown", also=(".markdown",)
    ),
    "mermaid": Format("a Mermaid flowchart", ".mmd", "export.mermaid:to_mermaid", also=(".mermaid",)),
    "dot": Format("a Graphviz graph", ".dot", "export.dot:to_dot", also=(".gv",)),
    "latex": Format("a LaTeX picture, by forest", ".tex", "export.latex:to_latex"),
}


SUFFIXES: Mapping[str, str] = {suffix: name for name, form in FORMATS.items() for suffix in form.suffixes}
"""The name of the format that files of a suffix have."""


def canonical(name: str) -> str:
    """Return the name of a format that is called by its suffix: ``"javascript"`` for ``"js"``."""
    return name if name in FORMATS else SUFFIXES.get(f".{name}", name)


def format_of(name: str) -> Format:
    """The format of a name, or of a suffix without its dot, such as ``"js"``. Raises ValueError, naming all."""
    if (known := canonical(name)) not in FORMATS:
        raise ValueError(f"unknown format {name!r}; there are {', '.join(FORMATS)}")
    return FORMATS[known]
