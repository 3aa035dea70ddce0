"""A tree as a Python program: one file, no dependencies, a function ``act(observation)``.

Names come from strangers. In the program they stand in string literals, in ASCII, and in comments, without
control characters; nowhere else.

Where features are groups, the program asks what it sees in words: ``if see['front'] == 'lava'``. It knows all
groups of the tree, also those it never asks about: as the tree does, it refuses an observation in which one
is not one-hot.
"""

from __future__ import annotations

import builtins
import keyword
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..actions import DiscreteActions, MultiDiscreteActions
from ..base import BaseTree
from ..floats import double_threshold
from ..groups import Group
from ..text import asked_group, node_words
from .common import Answers, Step, answers, branch_words, filled, nested_ifs, variables
from .toolchain import Run, timed

if TYPE_CHECKING:
    from jaxtyping import Float32

_HEADER = '''\
"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number per feature, in the order of FEATURES, and returns {answer}.
The tree compares float32 numbers. Thresholds are written so that comparing float (and float32) numbers with them
decides the same: each is the largest float that rounds to what its comment says.
"""
{imports}
FEATURES = {features}
{groups}

def act(observation):
{unpack}{body}

if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
'''

_UNPACK = """\
    try:
        {unpacked} = observation
    except ValueError:
        raise ValueError(f"expected {{len(FEATURES)}} numbers {{FEATURES}}, got {{observation}}") from None
"""

# with groups all of them are looked at before the first question, and numbers are the exception
_UNPACK_GROUPS = """\
    x = list(observation)
    if len(x) != len(FEATURES):
        raise ValueError(f"expected {len(FEATURES)} numbers {FEATURES}, got {len(x)}")
    see = _seen(x)
"""

_GROUPS = """\

# choices: the name, the features of which exactly one is 1 and the others are 0, and what each says when it is 1
GROUPS = {groups}


def _seen(x):
    see = {{}}
    for name, features, categories in GROUPS:
        values = [x[feature] for feature in features]
        if values.count(1) != 1 or values.count(0) != len(values) - 1:
            # to the tree they are float32 numbers, and below float32's normal range they are 0
            values = [value if abs(value) >= 2.0**-126 else value * 0.0 for value in array("f", values)]
            if values.count(1) != 1 or values.count(0) != len(values) - 1:
                raise ValueError(f"{{name!r}} must be a single 1 and otherwise 0, got {{values}} in {{x}}")
        see[name] = categories[values.index(1)]
    return see
"""

_ANSWERS = {DiscreteActions: "an int", MultiDiscreteActions: "a tuple of ints"}
_TAKEN = {*dir(builtins), *keyword.kwlist, "act", "observation", "array", "see", "x"}


def to_python(tree: BaseTree) -> str:
    """Write a program that acts as `DecisionTree.predict` does on every observation, to the bit.

    An action is an int where actions are discrete, a tuple of ints for several components, and a flat list of
    floats, in C order, where they are continuous. As the tree does, it raises ValueError, naming the
    observation, where a group of features is not one-hot.

    An observation is any sequence of floats, integers up to 2^53, or NumPy's float32 and float64 (not float16). Where
    there are no groups the numbers are unpacked, and never rounded: the thresholds are `double_threshold`.

    Args:
        tree: The tree to write.

    Returns:
        The text of the module.
    """
    choices = _distinct(group.name or "choice" for group in tree.groups)
    labelled = {
        group: _Labels(choice, dict(zip(group.features, _distinct(group.categories), strict=True)))
        for choice, group in zip(choices, tree.groups, strict=True)
    }
    groups = [
        (labels.choice, group.features, tuple(labels.category.values())) for group, labels in labelled.items()
    ]
    names = [f"x[{i}]" for i in range(tree.n_features)] if groups else variables(tree.feature_names, _TAKEN)
    return _HEADER.format(
        answer=_ANSWERS.get(type(tree.actions), "a list of floats"),
        imports="\nfrom array import array\n" if groups else "",
        features=_lines(tree.feature_names),
        groups=_GROUPS.format(groups=_lines(groups)) if groups else "",
        unpack=_UNPACK_GROUPS if groups else _UNPACK.format(unpacked=_unpacked(names)),
        body=_body(tree, names, labelled),
    )


@dataclass(frozen=True)
class _Labels:
    """What a group and its features are called in the program, where each name must say which one is meant."""

    choice: str
    category: dict[int, str]


def _distinct(names: Iterable[str]) -> tuple[str, ...]:
    """Number names that come again: ``door``, ``door (2)``."""
    distinct: dict[str, int] = {}
    for name in names:
        new = name
        while new in distinct:
            distinct[name] += 1
            new = f"{name} ({distinct[name]})"
        distinct[new] = 1
    return tuple(distinct)


def _lines(items: Iterable[object]) -> str:
    """Write a tuple, an item a line, in ASCII."""
    lines = "".join(f"    {item!a},\n" for item in items)
    return f"(\n{lines})" if lines else "()"


def _unpacked(names: list[str]) -> str:
    flat = ", ".join(names)
    return f"[{flat}]" if len(flat) < 80 else f"[\n{filled(names, ' ' * 12)}\n        ]"


def _body(tree: BaseTree, names: list[str], labelled: dict[Group, _Labels]) -> str:
    rows = answers(tree)

    def head(step: Step) -> str:
        return f"if {_condition(tree, step, names, labelled)}"

    def answer(leaf: int) -> list[str]:
        return [f"return {_answer(rows, leaf, tree)}  # {node_words(tree, leaf)}"]

    return nested_ifs(tree, "    ", head, None, answer)


def _condition(tree: BaseTree, step: Step, names: list[str], labelled: dict[Group, _Labels]) -> str:
    """Ask a question as Python does, and in words where that does not read by itself."""
    feature, words = int(tree.feature[step.node]), branch_words(tree, step)
    if (group := asked_group(tree, step.node)) is not None:
        labels = labelled[group]
        comment = "" if words.isascii() else f"  # {words}"
        compared = "!=" if step.side == "left" else "=="
        return f"see[{labels.choice!a}] {compared} {labels.category[feature]!a}:{comment}"
    asked = f"{names[feature]} <= {double_threshold(tree.threshold[step.node])!r}"
    return f"{asked if step.side == 'left' else f'not {asked}'}:  # {words}"


def _answer(rows: Answers, leaf: int, tree: BaseTree) -> str:
    answer = rows.of(leaf)
    if rows.single:
        return repr(answer[0])
    return repr(tuple(answer) if isinstance(tree.actions, MultiDiscreteActions) else answer)


def run_python(tree: BaseTree, x: Float32[np.ndarray, "batch features"], rounds: int) -> Run:
    """Run the program on observations, as lists of floats: see `sympol.trees.export.check`."""
    namespace: dict[str, Any] = {"__name__": "policy"}
    exec(compile(to_python(tree), "policy.py", "exec"), namespace)
    act, lists = namespace["act"], x.tolist()
    actions, seconds = timed(rounds, lambda: [act(row) for row in lists])
    return Run(np.array(actions, answers(tree).rows.dtype), seconds)
