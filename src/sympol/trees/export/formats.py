"""The table of formats: all that commands, pages and checks know about what a tree can be exported to."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, final

from ..base import BaseTree

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float32

    from .toolchain import Run


@final
@dataclass(frozen=True)
class Format:
    """A format that a tree can be written in.

    Args:
        title: A name for people, such as ``"Python, without dependencies"``.
        suffix: The usual suffix of its files, with the dot.
        writer: The function that writes a tree, as ``"module:function"`` relative to `sympol.trees`. It is imported
            on first use. Its keyword arguments are the options of the format.
        runner: The function that runs what the writer wrote, in the same form; empty if that cannot be run.
        styles: The values of the writer's option ``style``, the default first.
        binary: Whether the writer returns bytes.
        also: Other suffixes that such files have.
    """

    title: str
    suffix: str
    writer: str
    runner: str = ""
    styles: tuple[str, ...] = ()
    binary: bool = False
    also: tuple[str, ...] = ()

    @property
    def suffixes(self) -> tuple[str, ...]:
        """All suffixes of its files, the usual one first."""
        return (self.suffix, *self.also)

    @property
    def options(self) -> tuple[str, ...]:
        """The options of `write`."""
        return tuple(inspect.signature(_function(self.writer)).parameters)[1:]

    def write(self, tree: BaseTree, **options: Any) -> str | bytes:
        """Write a tree.

        Args:
            tree: The tree.
            options: Some of `options`.

        Returns:
            The text, or the bytes if the format is binary.

        Raises:
            ImportError: If a library is missing; the message says how to install it.
            ValueError: If the format cannot hold the tree, or an option has another value.
        """
        return _function(self.writer)(tree, **options)

    def run(
        self, tree: BaseTree, x: Float32[np.ndarray, "batch features"], rounds: int, **options: Any
    ) -> Run:
        """Write a tree and run what was written on observations: see `sympol.trees.export.check.run`.

        Args:
            tree: The tree.
            x: Observations, ``[batch, features]``.
            rounds: How often they are answered, for timing.
            options: Options of the format; see ``options``.

        Returns:
            The answers, and how long they took.
        """
        return _function(self.runner)(tree, x, rounds, **options)


def _function(where: str) -> Callable[..., Any]:
    module, function = where.split(":")
    return getattr(import_module(f"..{module}", __package__), function)


_CODE = ("ifs", "table")
# fmt: off
FORMATS: Mapping[str, Format] = {
    "python": Format("Python, without dependencies", ".py", "export.python:to_python", "export.python:run_python"),
    "c": Format("C99, no allocation, no library", ".c", "export.c:to_c", "export.c:run_c", _CODE),
    "c-header": Format("the header of the C file", ".h", "export.c:to_c_header", also=(".hpp", ".hh")),
    "rust": Format("Rust, no_std, no dependencies", ".rs", "export.rust:to_rust", "export.rust:run_rust"),
    "javascript": Format("JavaScript, an ES module", ".js", "export.javascript:to_javascript",
                         "export.javascript:run_javascript", _CODE, also=(".mjs",)),
    "sql": Format("SQL, a query of PostgreSQL or SQLite", ".sql", "export.sql:to_sql", "export.sql:run_sql",
                  ("postgresql", "sqlite")),
    "onnx": Format("ONNX, for onnxruntime", ".onnx", "export.onnx:to_onnx", "export.onnx:run_onnx", binary=True),
    "treelite": Format("a Treelite model", ".treelite", "export.treelite:to_treelite", "export.treelite:run_treelite",
                       binary=True),
    "json": Format("JSON, read again by DecisionTree.from_json", ".json", "serialize:to_json"),
    "text": Format("text, for people", ".txt", "text:to_text"),
    "markdown": Format("a Markdown table of rules", ".md", "export.markdown:to_markdown", also=(".markdown",)),
    "mermaid": Format("a Mermaid flowchart", ".mmd", "export.mermaid:to_mermaid", also=(".mermaid",)),
    "dot": Format("a Graphviz graph", ".dot", "export.dot:to_dot", also=(".gv",)),
    "latex": Format("a LaTeX picture, by forest", ".tex", "export.latex:to_latex"),
}
# fmt: on
"""All formats by name."""
SUFFIXES: Mapping[str, str] = {suffix: name for name, form in FORMATS.items() for suffix in form.suffixes}
"""The name of the format of files with a suffix."""


def canonical(name: str) -> str:
    """Return the name of a format given by its suffix, such as ``"javascript"`` for ``"js"``; others unchanged."""
    return name if name in FORMATS else SUFFIXES.get(f".{name}", name)


def format_of(name: str) -> Format:
    """Return the format of a name, or of a suffix without its dot.

    Args:
        name: The name or suffix.

    Returns:
        The format.

    Raises:
        ValueError: If there is none; the message lists all names.
    """
    if (known := canonical(name)) not in FORMATS:
        raise ValueError(f"unknown format {name!r}; there are {', '.join(FORMATS)}")
    return FORMATS[known]


def check_style(name: str, style: str) -> str:
    """Return a style if a format has it.

    Raises:
        ValueError: If it has not; the message lists all styles.
    """
    styles = FORMATS[name].styles
    if style not in styles:
        raise ValueError(f"style must be {' or '.join(styles)}, got {style!r}")
    return style
