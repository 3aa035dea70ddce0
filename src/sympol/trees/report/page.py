"""The page itself: its parts and its data put together as one file of HTML.

Nothing of the data is ever markup or code: it is in one block of JSON without any ``<``, and the page writes it
as text. What runs is named by its hash in the page's own policy (Content-Security-Policy), so that nothing else
does; no address is ever asked for anything.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any, Literal, TypeAlias

from ..floats import printable

Kind: TypeAlias = Literal["report", "compare"]
"""The kind of a page, which is the name of the script that builds it."""

_STYLES = ("page.css", "tree.css", "panels.css")
_SCRIPTS = (
    "dom.js",
    "decide.js",
    "layout.js",
    "nodes.js",
    "zoom.js",
    "tree.js",
    "leaf.js",
    "observation.js",
    "drawings.js",
    "player.js",
    "charts.js",
    "sections.js",
    "lane.js",
)


def write_page(title: str, kind: Kind, data: Mapping[str, Any]) -> str:
    """Write the page of a kind, with what it shows.

    Raises:
        ValueError: a number in ``data`` is not finite, for JSON has no other.
    """
    script = f'"use strict";\n(() => {{\n{_joined([*_SCRIPTS, f"{kind}.js"])}}})();\n'
    style = _joined(_STYLES)
    parts = {
        "title": html.escape(printable(title)),
        "policy": _policy(script, style),
        "style": style,
        "data": _without_markup(data),
        "script": script,
    }
    # each place once, in one go: what is put in is not looked at again
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _read("page.html"))


def _policy(script: str, style: str) -> str:
    rules = {
        "default-src": "'none'",
        "script-src": _hash(script),
        "style-src": _hash(style),
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _without_markup(data: Mapping[str, Any]) -> str:
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))  # ASCII: JSON escapes all else
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _joined(names: Sequence[str]) -> str:
    return "\n".join(map(_read, names))


def _read(name: str) -> str:
    return files(__package__ or "").joinpath(name).read_text(encoding="utf-8")
