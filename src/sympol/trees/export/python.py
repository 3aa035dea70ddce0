"""A tree as a Python program: one file, no dependencies, a function ``act(observation)``.

Names come from strangers. In the program they stand in string literals, in ASCII, and in comments, without
control characters; nowhere else.

Where features are groups, the program asks what it sees in words: ``if see['front'] == 'lava'``. It knows all
groups of the tree, also those it never asks about: as the tree does, it refuses an observation in which one
is not one-hot.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..actions import DiscreteActions, MultiDiscreteActions
from ..floats import unflushed_threshold
from ..groups import Group
from ..text import asked_group, node_words, question
from ..tree import DecisionTree

# Python refuses 100 levels of indentation, and people refuse more than a few
MAX_NESTING = 8
# an elif is nested to the parser, and it refuses some thousands
MAX_LINKS = 20

_HEADER = '''\
"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number a feature, in the order of FEATURES, and returns {answer}.
"""

from array import array

FEATURES = {features}
{groups}

def act(observation):
    # the tree compares float32 numbers, so the observation is rounded to float32 first
    x = array("f", list(observation))
    if len(x) != len(FEATURES):
        raise ValueError(f"expected {{len(FEATURES)}} numbers {{FEATURES}}, got {{len(x)}}")
    return _node_0({arguments})

'''

_GROUPS = """\

# choices: the name, the features of which exactly one is 1 and the others are 0, and what each says when it is 1
GROUPS = {groups}
"""

_SEEN = """\

def _seen(x):
    see = {}
    for name, features, categories in GROUPS:
        values = [x[feature] for feature in features]
        # as to the tree, a number below float32's normal range is 0
        if values.count(1) != 1 or sum(abs(value) < 2.0**-126 for value in values) != len(values) - 1:
            raise ValueError(f"{name!r} must be a single 1 and otherwise 0, got {values} in {x.tolist()}")
        see[name] = categories[values.index(1)]
    return see

"""

_FOOTER = """\
if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
"""

_ANSWERS = {DiscreteActions: "an int", MultiDiscreteActions: "a tuple of ints"}


def to_python(tree: DecisionTree) -> str:
    """Write the program. It acts as `DecisionTree.predict` does on every observation, to the bit.

    An action is an int where actions are discrete, a tuple of ints for several components, and a flat list of
    floats, in C order, where they are continuous. As the tree does, it raises ValueError, naming the
    observation, where a group of features is not one-hot.
    """
    choices = _distinct(group.name or "choice" for group in tree.groups)
    labelled = {
        group: _Labels(choice, dict(zip(group.features, _distinct(group.categories), strict=True)))
        for choice, group in zip(choices, tree.groups, strict=True)
    }
    groups = [
        (labels.choice, group.features, tuple(labels.category.values())) for group, labels in labelled.items()
    ]
    arguments = "x, see" if groups else "x"
    header = _HEADER.format(
        answer=_ANSWERS.get(type(tree.actions), "a list of floats"),
        features=_lines(tree.feature_names),
        groups=_GROUPS.format(groups=_lines(groups)) if groups else "",
        arguments="x, _seen(x)" if groups else "x",
    )
    lines = [header + (_SEEN if groups else "")]
    functions = [0]
    for root in functions:  # grows while it is written
        lines += [f"def _node_{root}({arguments}):", *_body(tree, root, functions, labelled), "", ""]
    return "\n".join([*lines, _FOOTER])


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


def _body(tree: DecisionTree, root: int, functions: list[int], labelled: dict[Group, _Labels]) -> list[str]:
    """Write nested ifs; what would nest too deeply is added to the functions still to be written."""
    lines: list[str] = []
    awaited: list[tuple[int, int, int]] = [(root, 1, 0)]
    while awaited:
        node, nesting, links = awaited.pop()
        indent = "    " * nesting
        if node < 0:  # an else between two children
            lines.append(indent + "else:")
        elif tree.is_leaf[node]:
            lines.append(f"{indent}return {_answer(tree, node)}  # {node_words(tree, node)}")
        elif nesting > MAX_NESTING:
            functions.append(node)
            lines.append(f"{indent}return _node_{node}({'x, see' if labelled else 'x'})")
        else:
            asked = question(tree, node)
            lines.append(f"{indent}{'elif' if links else 'if'} {_condition(tree, node, labelled)}")
            if labelled and links < MAX_LINKS and not tree.is_leaf[asked.no_child]:
                awaited.append((asked.no_child, nesting, links + 1))
            else:
                awaited += [(asked.no_child, nesting + 1, 0), (-1, nesting, 0)]
            awaited.append((asked.yes_child, nesting + 1, 0))
    return lines


def _condition(tree: DecisionTree, node: int, labelled: dict[Group, _Labels]) -> str:
    """Ask a question as Python does, and in words where that does not read by itself."""
    feature, words = int(tree.feature[node]), node_words(tree, node)
    if (group := asked_group(tree, node)) is not None:
        labels = labelled[group]
        comment = "" if words.isascii() else f"  # {words}"
        return f"see[{labels.choice!a}] == {labels.category[feature]!a}:{comment}"
    return f"x[{feature}] <= {unflushed_threshold(tree.threshold[node])!r}:  # {words}"


def _answer(tree: DecisionTree, leaf: int) -> str:
    action = tree.actions.decide(tree.value[leaf : leaf + 1])[0]
    if isinstance(tree.actions, DiscreteActions):
        return repr(int(action))
    flat = np.ravel(action).tolist()
    return repr(tuple(flat) if isinstance(tree.actions, MultiDiscreteActions) else flat)
