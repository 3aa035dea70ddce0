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

_PROVENANCE = ("env", "env_kwargs", "wrappers", "not_kept", "seed", "preset", "sympol", "distilled", "start")
"""Metadata of the run that the package's README names, where it is not empty."""


def export_package(source: Path, folder: Path | None, name: str | None) -> int:
    """Write the package of a tree, and print where.

    Args:
        source: A run's folder, or the file of a tree.
        folder: The package's folder, which must not exist or be empty.
        name: The package's name; by default its folder's.

    Returns:
        The exit status.

    Raises:
        RunError: There is no folder, it is not empty, or it cannot be written.
        ValueError: Python cannot import a package of this name.
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
    """Return the tree, with the metadata of its run."""
    tree = tree_from(source)
    if not source.is_dir():
        return tree
    metadata = Run.open(source).metadata
    provenance = {key: value for key in _PROVENANCE if (value := metadata.get(key)) not in (None, {}, [], "")}
    return replace(tree, meta={**tree.meta, **provenance})
