"""The first line of every docstring is a sentence, and words that were given up do not come back."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "sympol"
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "images" not in path.parts),
]
GENERATED = {ROOT / "docs" / "tables.md", ROOT / "docs" / "fronts.md"}
MODULES = sorted(SOURCE.rglob("*.py"))

FRAGMENT = re.compile(r"(Of|What|Where|Whether|How|Which|Who|Whose|When|As|To|For|From|And|That)\b")

WORDS = {
    r"comes? by\b|came by\b|coming by\b": "reach, visit",
    r"\bgo(es)? on with\b|\bwent on with\b|\bgoes on\b": "resume, continue",
    r"\bdear(er|est)?\b": "expensive",
    r"\bidem\b": "repeat it",
    r"\bwhoever\b": "the caller, the user",
    r"\broads?\b": "method",
    r"\barenas?\b": "evaluator",
    r"\blooked up\b": "tabular",
    r"\bsprouts?\b": "insertion",
    r"\blandings? flew\b|\bis flown\b": "is simulated",
    r"\bwas asked of us\b|\bwe were asked\b": "published",
    r"\brooms? more\b": "further packages",
    r"\bon the spot\b": "immediately",
    r"\bpolish(ed|es|ing)?\b": "fine-tune",
    r"\bregrow(s|n|ing)?\b": "re-split",
    r"\bways? taken\b|\bthe way through\b": "path",
    r"\brivals?\b": "baseline",
    r"\bwithout a word\b": "silently",
}
"""A pattern, and what to write in its place."""


def first_lines(path: Path) -> list[tuple[str, str]]:
    """The names of everything public with a docstring, and the first sentence of each."""
    found = []

    def visit(node: ast.AST, name: str) -> None:
        text = ast.get_docstring(node)  # pyright: ignore[reportArgumentType]
        if text:
            found.append((name, text.split("\n\n")[0].replace("\n", " ")))
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.ClassDef | ast.FunctionDef) and not child.name.startswith("_"):
                visit(child, f"{name}.{child.name}")

    visit(ast.parse(path.read_text(encoding="utf-8")), path.relative_to(SOURCE).as_posix())
    return found


def prose_of(path: Path) -> list[tuple[int, str]]:
    """The lines of a page outside fences, or the lines of a module that hold docstrings and comments."""
    lines = path.read_text(encoding="utf-8").splitlines()
    if path.suffix == ".md":
        kept, inside = [], False
        for number, line in enumerate(lines, 1):
            inside ^= line.lstrip().startswith("```")
            if not inside:
                kept.append((number, re.sub(r"`[^`]*`|\]\([^)]*\)|<!--.*?-->", "", line)))
        return kept
    spans: set[int] = set()
    for node in ast.walk(ast.parse("\n".join(lines))):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            spans |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return [
        (
            number,
            re.sub(
                r"`[^`]*`",
                "",
                line if number in spans else line[line.index("  # ") if "  # " in line else 0 :],
            ),
        )
        for number, line in enumerate(lines, 1)
        if number in spans or line.lstrip().startswith("#") or "  # " in line
    ]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(SOURCE).as_posix())
def test_first_lines_are_sentences(path: Path):
    wrong = [
        f"{name}: {line}"
        for name, line in first_lines(path)
        if FRAGMENT.match(line) or not line.rstrip().endswith((".", ":", "?", "…"))
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("path", [*PAGES, *MODULES], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_words_given_up_do_not_come_back(path: Path):
    name = path.relative_to(ROOT).as_posix()
    if path in GENERATED:
        pytest.skip("generated")
    wrong = [
        f"{name}:{number}: {match[0]!r} (write: {better})"
        for number, line in prose_of(path)
        for pattern, better in WORDS.items()
        if (match := re.search(pattern, line, re.IGNORECASE))
    ]
    assert not wrong, "\n".join(wrong)
