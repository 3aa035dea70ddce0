"""Put the table of hyperparameters, made of their declarations, in the place of a marker in a page."""

import ast
import sys
from pathlib import Path
from typing import Any

MARKER = "<!-- table of knobs -->"
SOURCE = Path(__file__).resolve().parents[1] / "src"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace the marker; called by MkDocs for every page."""
    return markdown.replace(MARKER, table()) if MARKER in markdown else markdown


def table() -> str:
    """Return one row for each field of the config, in the order of its declaration."""
    sys.path.insert(0, str(SOURCE))
    from sympol.algorithms.config import KNOBS, Config  # imports no JAX

    rows = ["| field | default | range | only | meaning |", "|---|---|---|---|---|"]
    defaults = Config()
    for name, meaning in meanings().items():
        knob = KNOBS[name]
        bounds = f"{knob.low:.12g} to {knob.high:.12g}" if None not in (knob.low, knob.high) else ""
        bounds = bounds or (f"from {knob.low:.12g}" if knob.low is not None else ", ".join(knob.choices))
        only = ", ".join(knob.only)
        rows.append(f"| `{name}` | `{getattr(defaults, name)}` | {bounds} | {only} | {meaning} |")
    return "\n".join(rows)


def meanings() -> dict[str, str]:
    """Return the string below each field's declaration, on one line."""
    module = ast.parse((SOURCE / "sympol" / "algorithms" / "config.py").read_text(encoding="utf-8"))
    (config,) = (node for node in module.body if isinstance(node, ast.ClassDef) and node.name == "Config")
    found = {}
    for field, text in zip(config.body, config.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
            found[ast.unparse(field.target)] = " ".join(ast.literal_eval(text.value).split()).replace(
                "|", "\\|"
            )
    return found
