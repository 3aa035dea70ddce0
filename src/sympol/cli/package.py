"""``sympol export --to package``: a tree as a Python package in a folder of its own."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path

from .. import files
from ..runs.metadata import RunError
from ..runs.run import Run
from ..trees import DecisionTree
from ..trees.export.package import to_package
from .console import err
from .tree_io import tree_from

_SAID = ("env", "env_kwargs", "wrappers", "not_kept", "seed", "preset", "sympol", "distilled", "start")
"""What the README says of the run the tree is from, where there is something to say."""


def export_package(source: Path, folder: Path | None, name: str | None) -> int:
    """Write the package of a run's tree, or of a file's, and say where; it is called as its folder is by default.

    Raises:
        RunError: no folder, or it has something in it, or cannot be written.
        ValueError: the name is none that Python imports.
    """
    if folder is None:
        raise RunError("a package is a folder: say which, as in --out my_policy")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RunError(f"{folder} is there already; choose another --out, or remove it")
    name = re.sub(r"\W+", "_", folder.absolute().name.lower()) if name is None else name
    written = to_package(_tree(source), name)
    try:
        for path, text in written.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            files.write(folder / path, text)
    except OSError as error:
        raise RunError(f"cannot write {folder}: {error.strerror}; choose another --out") from error
    install = shlex.quote(str(folder.absolute()))
    err.print(f"written to {folder}; install it: pip install {install}", markup=False)
    return 0


def _tree(source: Path) -> DecisionTree:
    """The tree, with what its run says of itself."""
    tree = tree_from(source)
    if not source.is_dir():
        return tree
    about = Run.open(source).metadata
    return replace(
        tree,
        meta={**tree.meta, **{key: about[key] for key in _SAID if about.get(key) not in (None, {}, [], "")}},
    )
