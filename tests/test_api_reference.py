"""Every object of the API reference says what it takes, returns and raises.

The pages in ``docs/api`` decide what is public; the sources are read, not imported.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

griffe = pytest.importorskip("griffe")

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs" / "api").glob("*.md"))

FRAGMENT = re.compile(r"(Of|What|Where|Whether|How|Which|Who|As|To|For|And|From)\b")


@cache
def package() -> Any:
    return griffe.load("sympol", search_paths=[str(ROOT / "src")], docstring_parser="google")


def find(path: str) -> Any:
    found = package()
    for part in path.split(".")[1:]:
        found = found[part]
    return found.final_target if found.is_alias else found


def listed() -> dict[str, Any]:
    """The objects on the pages, and the public functions, classes and methods inside them."""
    roots = [name for page in PAGES for name in re.findall(r"^::: (\S+)$", page.read_text("utf-8"), re.M)]
    objects: dict[str, Any] = {}

    def add(thing: Any) -> None:
        objects[thing.path] = thing
        for name, member in thing.members.items():
            if name.startswith("_") or member.is_alias or member.is_attribute or member.is_module:
                continue
            add(member)

    for root in roots:
        try:
            add(find(root))
        except KeyError:
            objects[root] = None
    return objects


OBJECTS = listed()


def sections(thing: Any) -> dict[str, Any]:
    if thing.docstring is None:
        return {}
    return {section.kind.value: section.value for section in thing.docstring.parse("google")}


def arguments_of(function: Any) -> set[str]:
    return {parameter.name.lstrip("*") for parameter in function.parameters} - {"self", "cls"}


def raised_in(thing: Any) -> set[str]:
    """The exceptions that the function itself raises; those of what it calls are the author's to name."""
    lines = thing.lines
    indent = len(lines[0]) - len(lines[0].lstrip())
    (function,) = ast.parse("\n".join(line[indent:] for line in lines)).body
    names: set[str] = set()
    todo: list[ast.AST] = list(ast.iter_child_nodes(function))
    while todo:
        node = todo.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Lambda):
            continue
        if (
            isinstance(node, ast.Raise)
            and node.exc is not None
            and "please report" not in ast.unparse(node.exc)
        ):
            raised = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
            name = ast.unparse(raised)
            if name.split(".")[-1][:1].isupper():
                names.add(name.split(".")[-1])
        todo += ast.iter_child_nodes(node)
    return names - {"NotImplementedError"}


def complaints(thing: Any) -> list[str]:
    if thing.docstring is None:
        return ["has no docstring"]
    parts, wrong = sections(thing), []
    first = thing.docstring.value.split("\n\n")[0].replace("\n", " ").strip()
    if (
        not first.endswith((".", ":", "?"))
        or FRAGMENT.match(first)
        or not (first[0].isupper() or first[0] == "`")
    ):
        wrong.append(f"its first line is no sentence that stands alone: {first!r}")
    explained = {item.name.lstrip("*") for item in parts.get("parameters", [])}
    if thing.is_class:
        fields = {
            name
            for name, member in thing.members.items()
            if member.is_attribute and not name.startswith("_") and "property" not in member.labels
        }
        init = thing.members.get("__init__")
        explained |= {item.name for item in parts.get("attributes", [])}
        explained |= {name for name in fields if thing.members[name].docstring is not None}
        needed = arguments_of(init) if init is not None and init.is_function else fields
        if missing := sorted(needed - explained):
            wrong.append(f"Args lacks {', '.join(missing)}")
        return wrong
    if not thing.is_function:
        return wrong
    if missing := sorted(arguments_of(thing) - explained):
        wrong.append(f"Args lacks {', '.join(missing)}")
    returns = str(thing.returns) if thing.returns is not None else "None"
    if returns not in ("None", "NoReturn") and not parts.keys() & {"returns", "yields"}:
        wrong.append("has no Returns")
    told = " ".join(str(item.annotation) for item in parts.get("raises", []))
    if missing := sorted(name for name in raised_in(thing) if name not in told):
        wrong.append(f"Raises lacks {', '.join(missing)}")
    return wrong


def test_there_are_pages():
    assert len(OBJECTS) > 100


@pytest.mark.parametrize("path", OBJECTS)
def test_an_object_is_documented(path: str):
    thing = OBJECTS[path]
    assert thing is not None, f"{path} is on a page of docs/api and does not exist"
    wrong = complaints(thing)
    assert not wrong, f"{path}: {'; '.join(wrong)}"
