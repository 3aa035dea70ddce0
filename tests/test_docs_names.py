"""Every module, name, file and command that the documentation mentions exists."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    ROOT / "README.md",
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "images" not in path.parts),
]

ELSEWHERE = ("src/cartpole_policy", "tests/test_policy")
"""Files that a reader's own command writes."""


def python_of(text: str) -> list[str]:
    """The Python in fences, with the prompts of interactive sessions removed."""
    blocks = re.findall(r"^```(?:python|py)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    for session in re.findall(r"^```pycon\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        blocks.append(
            "\n".join(line[4:] for line in session.splitlines() if line[:4] in (">>> ", "... ", "..."))
        )
    return blocks


def imported(source: str) -> list[tuple[str, str | None]]:
    found: list[tuple[str, str | None]] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [(alias.name, None) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [(node.module, alias.name) for alias in node.names]
    return [(module, name) for module, name in found if module.split(".")[0] == "sympol"]


def exists(dotted: str) -> bool:
    """Whether a dotted path is a module of ours or something reached from one."""
    parts = dotted.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.util.find_spec(".".join(parts[:cut])) is not None
        except ModuleNotFoundError:
            found = False
        if found:
            thing = importlib.import_module(".".join(parts[:cut]))
            for part in parts[cut:]:
                if not hasattr(thing, part):
                    return part in getattr(thing, "__annotations__", {})
                thing = getattr(thing, part)
            return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_names_of_ours_exist(page: Path):
    text = page.read_text(encoding="utf-8")
    missing = []
    for block in python_of(text):
        for module, name in imported(block):
            if not exists(f"{module}.{name}" if name else module):
                missing.append(f"{module}.{name}" if name else module)
        missing += [name for name in re.findall(r"\bsympol(?:\.\w+)+(?=\()", block) if not exists(name)]
    for name in re.findall(r"`(sympol(?:\.\w+)+)(?:\([^`]*\))?`", text):
        if not exists(name) and not name.startswith(("sympol.tree", "sympol.front")):
            missing.append(name)
    for name in re.findall(r"python -m ((?:sympol|studies)(?:\.\w+)*)", text):
        path = ROOT.joinpath(*name.split("."))
        source = ROOT / "src" / path.relative_to(ROOT)
        if not any(
            (base.with_suffix(".py").exists() or (base / "__main__.py").exists()) for base in (path, source)
        ):
            missing.append(f"python -m {name}")
    for name in re.findall(r"`((?:docs|examples|studies|tests|src)/[\w./-]+)`", text):
        if not (ROOT / name).exists() and not name.startswith(ELSEWHERE):
            missing.append(name)
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_to_files_work_on_the_web_too(page: Path):
    """What a page links to is there, in the repository as on the site."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    links = [link.split("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text)]
    assert [link for link in links if link and ":" not in link and not (page.parent / link).exists()] == []
