"""``sympol export``: a tree as a program, a model, a document or a picture, checked with ``--check``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import tyro

from .. import files
from ..runs.metadata import RunError
from ..runs.run import Run
from ..trees import DecisionTree
from ..trees.export import FORMATS, SUFFIXES, canonical, format_of
from .arguments import Folder, PlaysRun, parse
from .console import err, print_error
from .show import is_soft, soft_view
from .tree_io import tree_from

if TYPE_CHECKING:
    from ..distill.soft_view import SoftView

PICTURES = ("svg", "pdf", "png")
PACKAGE = "package"
"""A folder of files, not one."""
_FOREIGN = (".jpg", ".jpeg", ".gif", ".webp", ".bmp", ".tif", ".tiff", ".eps", ".html", ".htm", ".zip")
"""Suffixes that promise what no export writes."""
OBSERVATIONS = 100_000
"""The observations of ``--check``."""
STYLES = ", ".join(f"{name} {'|'.join(form.styles)}" for name, form in FORMATS.items() if form.styles)

Write: TypeAlias = Callable[[Path], object]


@dataclass
class Export(PlaysRun):
    """Write a tree as a program, a model, a document or a picture.

    On a microcontroller: sympol export RUN --to c --style table --out policy.c --check
    """

    tree: Folder
    """A run's folder, a policy.json, or a listing in a .txt."""

    to: Annotated[str, tyro.conf.arg(metavar=f"{{{','.join((*FORMATS, *PICTURES, PACKAGE))}}}")] = ""
    """The format, or its suffix, such as js or md. By default the one of --out, else python."""

    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """The file, or the folder of a package; by default texts go to the standard output, pictures and models to
    RUN/tree.SUFFIX."""

    style: Annotated[str | None, tyro.conf.arg(help=f"How a program is written; {STYLES}.")] = None

    name: str | None = None
    """The prefix of names in C, and the name of an ONNX graph; policy by default. For a package its name, by default
    its folder's."""

    check: bool = False
    """Compile it, run it on 100,000 observations, and compare its actions with the tree's."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol export``."""
    given = parse(Export, "export", words)
    given = replace(given, to=_kind(given.to, given.out))
    if given.to == PACKAGE:
        return _package(given)
    if given.to not in PICTURES:
        _check_format(given)
    elif given.check or _options(given):
        raise ValueError(f"a picture takes no --style, --name or --check, and {given.to} is one")
    folder = Run.open(given.tree, given.env, trust=given.trust) if given.tree.is_dir() else None
    if folder is not None and is_soft(folder):
        written, draw = _soft_form(soft_view(folder, folder.load_summary()), given)
    else:
        tree = tree_from(given.tree)
        written = None if given.to in PICTURES else format_of(given.to).write(tree, **_options(given))
        draw = tree.plot
        if given.check:
            _check(tree, given.to, _options(given))
    _put(given, written, draw)
    return 0


def _kind(to: str, out: Path | None) -> str:
    """Return the format: that of ``--to``, or else of the file's suffix.

    Only what begins with a letter is a suffix: the file ``lr0.1`` has none.

    Raises:
        ValueError: The suffix is that of another format.
    """
    kind = canonical(to)
    suffix = out.suffix.lower() if out is not None and out.suffix[1:2].isalpha() else ""
    said = SUFFIXES.get(suffix, suffix[1:] if suffix[1:] in PICTURES else "")
    if not kind:
        if suffix and not said:
            raise ValueError(
                f"nothing that is exported has the suffix {suffix}, as in {out}; say what it is: --to"
            )
        return said or "python"
    if kind == PACKAGE or kind not in (*FORMATS, *PICTURES):  # a folder of any name, or refused later
        return kind
    if said not in ("", kind) or suffix in _FOREIGN or (suffix and not said and kind in PICTURES):
        ends = " or ".join(_suffixes(kind))
        raise ValueError(
            f"--to {to} writes a file that ends in {ends}, but --out is {out}; change the one or the other"
        )
    return kind


def _suffixes(kind: str) -> tuple[str, ...]:
    return (f".{kind}",) if kind in PICTURES else format_of(kind).suffixes


def _package(given: Export) -> int:
    from .package import export_package

    if given.check or given.style is not None:
        raise ValueError("a package takes no --style or --check: its own test is in it")
    return export_package(given.tree, given.out, given.name)


def _options(given: Export) -> Mapping[str, Any]:
    return {key: value for key in ("style", "name") if (value := getattr(given, key)) is not None}


def _check_format(given: Export) -> None:
    """Refuse an unknown format, or an option that it does not have."""
    try:
        taken = format_of(given.to).options
    except ValueError as error:
        raise ValueError(f"{error}, {', '.join((*PICTURES, PACKAGE))}") from None
    for option in _options(given):
        if option not in taken:
            raise ValueError(f"{given.to} takes no --{option}; leave it out")


def _soft_form(view: SoftView, given: Export) -> tuple[str | None, Write]:
    from ..distill.picture import plot_soft_tree
    from ..distill.soft_text import soft_text

    if given.to not in ("text", *PICTURES) or given.check:
        what = "not tried" if given.check else f"not {given.to}"
        raise RunError(
            f"{given.tree} holds a soft tree, which is written as {', '.join(('text', *PICTURES))}, {what}; make a "
            f"hard one of it: sympol distill {given.tree}"
        )
    return (soft_text(view) if given.to == "text" else None), lambda path: plot_soft_tree(view, path)


def _check(tree: DecisionTree, to: str, options: Mapping[str, Any]) -> None:
    """Check the exported program here, and print that it passed; end the command if it fails."""
    from ..trees.export.check import check

    try:
        check(tree, to, OBSERVATIONS, **options)
    except RuntimeError as error:
        print_error(error)
        raise SystemExit(1) from None
    err.print(f"checked: acts as the tree does on {OBSERVATIONS:,} observations", markup=False)


def _put(given: Export, written: str | bytes | None, draw: Write) -> None:
    """Write the text or the picture to --out, or to its default."""
    if isinstance(written, str):
        written = written if written.endswith("\n") else written + "\n"
        if given.out is None:
            print(written, end="")
            return
    suffix = f".{given.to}" if given.to in PICTURES else format_of(given.to).suffix
    folder = given.tree if given.tree.is_dir() else given.tree.parent
    path = given.out or folder / f"tree{suffix}"
    try:
        if written is None:
            path = path if path.suffix.lower() == suffix else path.with_name(path.name + suffix)
            draw(path)
        else:
            files.write(path, written)
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}; choose another --out") from error
    err.print(f"written to {path}", markup=False)
