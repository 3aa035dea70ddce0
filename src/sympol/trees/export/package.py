"""A tree as a Python package of its own: installable, typed, tested, without dependencies.

The program is that of `sympol.trees.export.python`. Beside it are its types, a README with the tree, and a test with
what the tree answered on both sides of every threshold that leads to a leaf.

Names come from strangers. In the README they stand in blocks of code that they cannot end; elsewhere, outside the
program, they do not occur.
"""

from __future__ import annotations

import json
import keyword
import math
import re
import sys
from typing import TYPE_CHECKING

import numpy as np

from ...version import __version__
from ..actions import BoxActions, DiscreteActions
from ..base import BaseTree
from ..boxes import leaf_boxes
from ..floats import shortest
from ..text import to_text
from .python import to_python

if TYPE_CHECKING:
    from jaxtyping import Float32

MAX_LEAVES = 500
"""Of a larger tree the test knows so many leaves, evenly taken."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")

_PYPROJECT = """\
[build-system]
requires = ["setuptools>=61"]
build-backend = "setuptools.build_meta"

[project]
name = "{distribution}"
version = "1.0.0"
description = "A decision tree policy, written by sympol."
readme = "README.md"
requires-python = ">=3.9"
dependencies = []

[tool.setuptools.packages.find]
where = ["src"]

[tool.setuptools.package-data]
{name} = ["py.typed", "*.pyi"]
"""

_INIT = '''\
"""A decision tree policy, written by sympol {version}.

act(observation) takes one number per feature, in the order of FEATURES, and returns {answer}.
"""

from .policy import FEATURES, act

__all__ = ["FEATURES", "act"]
'''

_STUB = """\
from collections.abc import Iterable

FEATURES: tuple[str, ...]

def act(observation: Iterable[float]) -> {type}: ...
"""

_TEST = '''\
"""The policy answers as the tree did of which it was made, on both sides of its thresholds and on odd numbers."""

from {name} import FEATURES, act

inf, nan = float("inf"), float("nan")

CASES = [
{cases}
]


def test_it_answers_as_the_tree():
    for observation, action in CASES:
        assert act(observation) == action, observation


def test_an_observation_of_another_length_is_refused():
    try:
        act([0.0] * (len(FEATURES) + 1))
    except ValueError:
        return
    raise AssertionError("nothing was said about one number too many")
'''

_README = """\
# {distribution}

A decision tree policy of {size}, written by sympol {version}. It needs nothing but Python.

```python
from {name} import act

act({observation})  # {action}
```

`act` takes one number per feature and returns {answer}. Install it with `pip install .`, test it with `pytest`.

## The tree

{tree}

## The features, in their order

{features}

## Where it is from

{meta}
"""


def to_package(tree: BaseTree, name: str) -> dict[str, str]:
    """Write the files of a package that pip can install.

    ``name`` is what it is imported as; ``from name import act``.

    Args:
        tree: The tree to write.
        name: The name of the package, as in ``from name import act``.

    Returns:
        The text of each file by its path, relative to the package's folder.

    Raises:
        ValueError: if the name is not one that Python imports, or is one of Python's own modules.
    """
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise ValueError(
            f"a package's name must be a lower-case word of letters, digits and _, as cartpole_policy is, got {name!r}"
        )
    if name in sys.stdlib_module_names or name == "tests":
        raise ValueError(
            f"{name!r} is the name of another module; choose one of your own, such as {name}_policy"
        )
    hint, answer = _answer(tree)
    words = {
        "name": name,
        "distribution": name.replace("_", "-").strip("-"),
        "version": __version__,
        "answer": answer,
        "type": hint,
    }
    observations = recorded(tree)
    cases = [(_numbers(x), _action(tree, x)) for x in observations]
    readme = _README.format(
        **words,
        size=f"{tree.n_nodes} nodes, {tree.n_leaves} leaves, depth {tree.depth}",
        observation=cases[0][0],
        action=cases[0][1],
        tree=_block(to_text(tree)),
        features=_block("\n".join(f"{i}: {name!a}" for i, name in enumerate(tree.feature_names))),
        meta=_block(json.dumps(tree.meta, indent=2)),
    )
    return {
        "pyproject.toml": _PYPROJECT.format(**words),
        "README.md": readme,
        f"src/{name}/__init__.py": _INIT.format(**words),
        f"src/{name}/policy.py": to_python(tree),
        f"src/{name}/policy.pyi": _STUB.format(**words),
        f"src/{name}/py.typed": "",
        "tests/test_policy.py": _TEST.format(
            name=name, cases="\n".join(f"    ({x}, {a})," for x, a in cases)
        ),
    }


def recorded(tree: BaseTree) -> Float32[np.ndarray, "batch features"]:
    """Return observations that tell: the lowest and the highest corner of what ends in each leaf, infinities and NaN.

    A corner is on a threshold, or on the first float32 above one, in every feature that the way to the leaf asks about.
    """
    boxes = leaf_boxes(tree, bounds=False)
    leaves = np.flatnonzero(~boxes.is_empty)
    leaves = leaves[np.linspace(0, len(leaves) - 1, min(len(leaves), MAX_LEAVES)).astype(int)]
    free = np.array([feature not in tree.group_of for feature in range(tree.n_features)], bool)
    rows = [boxes.some_observation(int(leaves[0]))]
    for leaf in leaves.tolist():
        inside = boxes.some_observation(leaf)
        for corner in (boxes.low[leaf], boxes.high[leaf]):
            rows.append(np.where(free & np.isfinite(corner), corner, inside))
    rows += [np.where(free, np.float32(odd), rows[0]) for odd in (np.nan, np.inf, -np.inf)]
    different = {row.tobytes(): row for row in np.array(rows, np.float32)}
    return np.array(list(different.values()))


def _answer(tree: BaseTree) -> tuple[str, str]:
    """The type of an action, and what it is in words."""
    if isinstance(tree.actions, DiscreteActions):
        return "int", "an int"
    if isinstance(tree.actions, BoxActions):
        return "list[float]", "a list of floats"
    return f"tuple[{', '.join(['int'] * len(tree.actions.nvec))}]", "a tuple of ints"


def _action(tree: BaseTree, x: Float32[np.ndarray, " features"]) -> str:
    action = tree.predict(x)
    if isinstance(tree.actions, DiscreteActions):
        return repr(int(action))
    flat = np.ravel(action).tolist()
    return repr(flat if isinstance(tree.actions, BoxActions) else tuple(flat))


def _numbers(x: Float32[np.ndarray, " features"]) -> str:
    return f"[{', '.join(repr(shortest(v) if math.isfinite(v) else float(v)) for v in x)}]"


def _block(text: str) -> str:
    """Markdown's block of code, its fence longer than any in the text."""
    fence = "`" * max(3, 1 + max((len(run) for run in re.findall("`+", text)), default=0))
    return f"{fence}text\n{text}\n{fence}"
