"""A tree as a Python program: one file, no dependencies, a function ``act(observation)``.

Names come from strangers. In the program they stand in a tuple of string literals, in ASCII, and in comments,
without control characters; nowhere else.
"""

from __future__ import annotations

import numpy as np

from ..actions import DiscreteActions, MultiDiscreteActions
from ..floats import unflushed_threshold
from ..text import node_words
from ..tree import DecisionTree

# Python refuses 100 levels of indentation, and people refuse more than a few
MAX_NESTING = 8

_HEADER = '''\
"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number a feature, in the order of FEATURES, and returns {answer}.
"""

from array import array

FEATURES = {features}


def act(observation):
    # the tree compares float32 numbers, so the observation is rounded to float32 first
    x = array("f", list(observation))
    if len(x) != len(FEATURES):
        raise ValueError(f"expected {{len(FEATURES)}} numbers {{FEATURES}}, got {{len(x)}}")
    return _node_0(x)

'''

_FOOTER = """\
if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
"""

_ANSWERS = {DiscreteActions: "an int", MultiDiscreteActions: "a tuple of ints"}


def to_python(tree: DecisionTree) -> str:
    """Write the program. It acts as `DecisionTree.predict` does on every observation, to the bit.

    An action is an int where actions are discrete, a tuple of ints for several components, and a flat list of
    floats, in C order, where they are continuous.
    """
    features = "".join(f"    {name!a},\n" for name in tree.feature_names)
    answer = _ANSWERS.get(type(tree.actions), "a list of floats")
    lines = [_HEADER.format(answer=answer, features=f"(\n{features})" if features else "()")]
    functions = [0]
    for root in functions:  # grows while it is written
        lines += [f"def _node_{root}(x):", *_body(tree, root, functions), "", ""]
    return "\n".join([*lines, _FOOTER])


def _body(tree: DecisionTree, root: int, functions: list[int]) -> list[str]:
    """Write nested ifs; what would nest too deeply is added to the functions still to be written."""
    lines: list[str] = []
    awaited: list[tuple[int, int]] = [(root, 1)]
    while awaited:
        node, nesting = awaited.pop()
        indent = "    " * nesting
        if node < 0:  # an else between two children
            lines.append(indent + "else:")
        elif tree.is_leaf[node]:
            lines.append(f"{indent}return {_answer(tree, node)}  # {node_words(tree, node)}")
        elif nesting > MAX_NESTING:
            functions.append(node)
            lines.append(f"{indent}return _node_{node}(x)")
        else:
            threshold = unflushed_threshold(tree.threshold[node])
            lines.append(f"{indent}if x[{tree.feature[node]}] <= {threshold!r}:  # {node_words(tree, node)}")
            left, right = int(tree.children_left[node]), int(tree.children_right[node])
            awaited += [(right, nesting + 1), (-1, nesting), (left, nesting + 1)]
    return lines


def _answer(tree: DecisionTree, leaf: int) -> str:
    action = tree.actions.decide(tree.value[leaf : leaf + 1])[0]
    if isinstance(tree.actions, DiscreteActions):
        return repr(int(action))
    flat = np.ravel(action).tolist()
    return repr(tuple(flat) if isinstance(tree.actions, MultiDiscreteActions) else flat)
