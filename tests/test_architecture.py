"""Imports go one way: types ← functional ← policies ← algorithms ← agents ← cli."""

from __future__ import annotations

import ast
import re
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
    "counts": set(),
    "types": set(),
    "seeds": set(),
    "version": set(),
    "compilation": set(),
    "threads": set(),
    "interrupts": set(),
    "terminal": set(),
    "provenance": {"threads", "version"},
    "console": {"trees"},
    "trees": {"files", "bounded", "version"},
    "results": {"trees", "files", "bounded"},
    "functional": {"types", "trees"},
    "envs": {"types", "trees", "compilation"},
    "policies": {"types", "functional", "trees"},
    "algorithms": {"types", "functional", "policies", "envs", "trees", "compilation", "files", "bounded"},
    "distill": {"types", "seeds", "functional", "policies", "envs", "trees", "algorithms", "play"},
    "film": {"types", "envs", "trees", "files"},
    "play": {"envs", "trees"},
    "evaluate": {"types", "envs", "trees", "film", "play"},
    "runs": {"console", "provenance", "types", "version", "envs", "trees", "algorithms", "files", "bounded"},
    "serving": {"envs", "trees", "play"},
    "parallel": {"console", "provenance", "compilation", "files", "bounded", "interrupts", "terminal"},
    "frameworks": {"functional", "policies", "envs", "trees", "play", "serving"},
}
"""What each room may import besides itself; what stands above them all is in TOP, lowest first."""
TOP = [
    "search",
    "trained_policy",
    "guided",
    "agents",
    "teachers",
    "training",
    "search.front",
    "report",
    "tune",
    "bench",
    "cli",
]
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


def imports_of(file: Path) -> set[tuple[str, str]]:
    """Return what a file imports anywhere, for the type checker, too: the module, and the name out of it or ""."""
    package = file.relative_to(ROOT.parent).with_suffix("").parts[:-1]
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {(alias.name, "") for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            source = ".".join([*base, *([node.module] if node.module else [])])
            found |= {(source, alias.name) for alias in node.names}
    return found


def imported(file: Path) -> set[str]:
    """Every module of ours that a file imports, wherever in it, relative names resolved."""
    found = {
        f"{source}.{name}" if name and source == PACKAGE else source for source, name in imports_of(file)
    }
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
    imports = re.compile(r"^\s*(from|import) studies\b", re.MULTILINE)
    assert not [file for file in FILES if imports.search(file.read_text(encoding="utf-8"))]


def circles(imports: dict[str, set[str]]) -> list[set[str]]:
    """Return the sets of modules that all import each other, directly or through others (Tarjan, 1972)."""
    order: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []

    def visit(module: str) -> None:
        order[module] = lowest[module] = len(order)
        stack.append(module)
        for other in imports[module]:
            if other not in order:
                visit(other)
                lowest[module] = min(lowest[module], lowest[other])
            elif other in stack:
                lowest[module] = min(lowest[module], order[other])
        if lowest[module] == order[module]:
            start = stack.index(module)
            circle = {*stack[start:]}
            del stack[start:]
            if len(circle) > 1 or module in imports[module]:
                found.append(circle)

    for module in imports:
        if module not in order:
            visit(module)
    return found


def modules_imported(file: Path, modules: set[str]) -> set[str]:
    """Return the modules among those given that a file imports, submodules of packages by their own names."""
    found = {name if (name := f"{source}.{part}") in modules else source for source, part in imports_of(file)}
    return found & modules


def test_no_module_imports_itself_through_others():
    modules = {module_of(file): file for file in FILES}
    found = circles({module: modules_imported(file, {*modules}) for module, file in modules.items()})
    assert not found, f"import circles: {found}; move what both need into a module below them"


def test_a_circle_is_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a", "d"}}) == [{"b", "c"}, {"d"}]


READS_LEAVES = re.compile(r"\b(?:tree|before|after|other|left|right|small|part)\.value\b|\]\.value\[")
"""The stored constants of a tree's leaves, as this project calls trees."""


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_outputs_are_the_way_from_a_leaf_to_numbers(file):
    if file.relative_to(ROOT) == Path("trees/base.py"):
        return
    found = READS_LEAVES.findall(file.read_text(encoding="utf-8"))
    assert not found, f"{found}: call tree.outputs(X), or read tree.leaf_outputs or tree.leaf_actions"


KNOWS_WORLDS = {"envs", "presets", "bench", "cli"}
"""Rooms that may name an environment (the command line in its examples); all others ask it for what it can do."""
WORLD = re.compile(r"LunarLander|MiniGrid|CartPole|Acrobot|Pendulum|MountainCar|DistShift")


def _code_strings(file: Path) -> set[str]:
    """Return the string literals of a module that are neither docstrings nor sentences (examples, messages, help)."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    prose |= {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    constants = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in prose)
    return {node.value for node in constants if isinstance(node.value, str) and " " not in node.value}


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_no_module_knows_an_environment_by_name(file):
    if room(module_of(file)) in KNOWS_WORLDS:
        return
    worlds = ("sympol.envs.classic", "sympol.envs.minigrid", "sympol.envs.lunar_lander")
    bad = {name for name in imported(file) if name.startswith(worlds)}
    if room(module_of(file)) != "cli":  # whose help has examples
        bad |= {text for text in _code_strings(file) if WORLD.search(text)}
    assert not bad, (
        f"{bad}: ask the environment for a capability, or put what is tuned for it into its preset file"
    )


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
