"""Imports go one way: types ← functional ← policies ← algorithms ← agents ← cli."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import sympol

ROOT = Path(sympol.__file__).parent
PACKAGE = "sympol"

BELOW: dict[str, set[str]] = {
    "files": set(),
    "bounded": set(),
    "types": set(),
    "compilation": set(),
    "threads": set(),
    "interrupts": set(),
    "terminal": set(),
    "provenance": {"threads"},
    "trees": {"files", "bounded"},
    "results": {"trees", "files", "bounded"},
    "functional": {"types", "trees"},
    "envs": {"types", "trees", "compilation"},
    "policies": {"types", "functional", "trees"},
    "algorithms": {"types", "functional", "policies", "envs", "trees", "compilation", "files", "bounded"},
    "distill": {"types", "functional", "policies", "envs", "trees", "algorithms", "play"},
    "film": {"types", "envs", "trees", "files"},
    "play": {"envs", "trees"},
    "evaluate": {"types", "envs", "trees", "film", "play"},
    "runs": {"types", "envs", "trees", "algorithms", "files", "bounded", "provenance"},
    "serving": {"envs", "trees", "play"},
    "parallel": {"compilation", "files", "bounded", "interrupts", "terminal", "provenance"},
    "frameworks": {"functional", "policies", "envs", "trees", "play", "serving"},
}
"""What each room may import besides itself; what stands above them all is in TOP, lowest first."""
TOP = ["search", "agents", "teachers", "training", "search.front", "report", "tune", "bench", "cli"]
for above in TOP:
    BELOW[above] = {*BELOW}  # what comes later in TOP is not in it yet
BELOW["__main__"] = {"cli"}
LAZY = "__init__"
"""The public face names its homes for the type checker and imports them on first use."""


def room(module: str) -> str:
    """``sympol.algorithms.ppo`` is in ``algos``."""
    if module.startswith("sympol.search.front"):
        return "search.front"  # what stands on agents; the rest of the room is below them
    return module.split(".")[1] if "." in module else LAZY


def module_of(file: Path) -> str:
    parts = file.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def imported(file: Path) -> set[str]:
    """Every module of ours that a file imports, wherever in it, relative names resolved."""
    package = file.relative_to(ROOT.parent).with_suffix("").parts[:-1]
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            source = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{source}.{alias.name}" for alias in node.names} if source == PACKAGE else {source}
    return {name for name in found if name == PACKAGE or name.startswith(f"{PACKAGE}.")}


FILES = sorted(ROOT.rglob("*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_imports_go_one_way(file):
    here = room(module_of(file))
    if here == LAZY:
        return
    assert here in BELOW, f"{here} has no place in the house yet: give it one in this test"
    for name in imported(file):
        # sympol.__version__ and the like are nobody's room
        there = room(name)
        if there in BELOW and there != here:
            assert there in BELOW[here], f"{module_of(file)} imports {name}: {here} may not import {there}"


def test_only_the_command_imports_bench():
    importers = {module_of(file) for file in FILES for name in imported(file) if room(name) == "bench"}
    assert {name for name in importers if room(name) != "bench"} <= {"sympol.cli.bench"}


def test_the_package_does_not_know_the_studies():
    assert not [file for file in FILES if "studies" in file.read_text(encoding="utf-8")]


def test_the_test_sees_relative_and_absolute_imports():
    assert "sympol.trees" in imported(ROOT / "policies" / "extract.py")
    assert "sympol.functional.float32_order" in imported(ROOT / "policies" / "extract.py")


@pytest.mark.parametrize(
    "statement", ["import sympol", "import sympol.trees", "from sympol import DecisionTree"]
)
def test_reading_a_tree_does_not_wait_for_jax(statement):
    heavy = {"jax", "equinox", "optax", "gymnasium", "matplotlib"}
    code = f"{statement}\nimport sys\nloaded = {heavy} & set(sys.modules)\nassert not loaded, loaded"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
