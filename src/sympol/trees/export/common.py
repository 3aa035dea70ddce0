"""Parts that the programs of all languages share: the order of their lines, their answers, their tables, safe names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING, Literal, TypeAlias, final

import numpy as np

from ..actions import BoxActions, DiscreteActions
from ..base import BaseTree
from ..floats import printable, unflushed_threshold
from ..preorder import visits
from ..text import asked_group, node_words, question

if TYPE_CHECKING:
    from jaxtyping import Float32, Int, Int64

MAX_HEIGHT = 8
"""Comparisons that may stand inside an ``if`` for the sake of reading first what "yes" leads to."""
LARGEST_ACTION = 2**53
"""Up to it every language's number is exact."""
WIDTH = 100

Side: TypeAlias = Literal["left", "right"]


@final
@dataclass(frozen=True)
class Step:
    """A line of a program of nested ifs: an ``if``, the answer of a leaf, or the end of what stands in an ``if``."""

    kind: Literal["if", "answer", "end"]
    node: int
    level: int
    side: Side = "left"
    """Of an ``if``: the child to which it leads."""


def steps(tree: BaseTree) -> Iterator[Step]:
    """The lines of a program, top to bottom: every ``if`` ends in an answer, so what follows it is its else.

    First comes what "yes" leads to; where that is more than `MAX_HEIGHT` high, the smaller child. So the nesting
    is at most ``MAX_HEIGHT + log2(leaves)``, however deep the tree is: no compiler is asked for more.
    """
    size, height = _sizes(tree)
    awaited: list[Step | tuple[int, int]] = [(0, 0)]
    while awaited:
        coming = awaited.pop()
        if isinstance(coming, Step):
            yield coming
            continue
        node, level = coming
        if tree.is_leaf[node]:
            yield Step("answer", node, level)
            continue
        asked = question(tree, node)
        first, then = asked.yes_child, asked.no_child
        if height[first] > MAX_HEIGHT and size[then] < size[first]:
            first, then = then, first
        yield Step("if", node, level, "left" if first == tree.children_left[node] else "right")
        awaited += [(then, level), Step("end", node, level), (first, level + 1)]


def nested_ifs(
    tree: BaseTree,
    indent: str,
    head: Callable[[Step], str],
    tail: str | None,
    answer: Callable[[int], list[str]],
) -> str:
    """Write a function's body, as `steps` orders it.

    Args:
        tree: What is written.
        indent: Of each level.
        head: The line of an ``if``.
        tail: What ends it; None where the end of the indentation does.
        answer: The lines of a leaf.
    """
    lines = []
    for step in steps(tree):
        if step.kind == "end":
            added = [] if tail is None else [tail]
        else:
            added = [head(step)] if step.kind == "if" else answer(step.node)
        lines += [indent * (step.level + 1) + line for line in added]
    return "\n".join(lines) + "\n"


def _sizes(tree: BaseTree) -> tuple[Int[np.ndarray, " nodes"], Int[np.ndarray, " nodes"]]:
    """The leaves below each node, and the comparisons on the longest way down from it."""
    size = visits(tree.children_left, tree.children_right, np.flatnonzero(tree.is_leaf))
    height = np.zeros(tree.n_nodes, np.int64)
    for node in np.flatnonzero(~tree.is_leaf)[::-1]:
        height[node] = 1 + max(height[tree.children_left[node]], height[tree.children_right[node]])
    return size, height


@final
@dataclass(frozen=True)
class Answers:
    """The different answers of a tree, flat, and which of them each leaf gives."""

    rows: Int64[np.ndarray, "answers outputs"] | Float32[np.ndarray, "answers outputs"]
    row_of: Int[np.ndarray, " nodes"]
    """-1 at inner nodes."""
    single: bool
    """Whether an answer is one number, not an array of them."""

    @property
    def n_outputs(self) -> int:
        """Numbers in an answer."""
        return self.rows.shape[1]

    @property
    def is_float(self) -> bool:
        """True if the answers are float32 numbers, False if they are integers."""
        return self.rows.dtype == np.float32

    def of(self, leaf: int) -> list[float]:
        """The answer of a leaf: ints, or floats that are exact."""
        return self.rows[self.row_of[leaf]].tolist()


def answers(tree: BaseTree) -> Answers:
    """The tree's answers, actions numbered from ``start`` and means clipped: what `DecisionTree.predict` returns.

    Raises:
        ValueError: if a number is infinite, or a whole one beyond 2^53.
    """
    leaves = np.flatnonzero(tree.is_leaf)
    decided = tree.leaf_actions[leaves].reshape(len(leaves), -1)
    if not (np.isfinite(decided) if decided.dtype == np.float32 else np.abs(decided) <= LARGEST_ACTION).all():
        raise ValueError(
            f"actions must be finite, and whole ones within ±2^53, which every language can hold; got {tree.actions!r}"
        )
    bits = decided.view(np.int32) if decided.dtype == np.float32 else decided  # -0.0 is not 0.0
    _, which, row = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    row_of = np.full(tree.n_nodes, -1)
    row_of[leaves] = row.ravel()
    return Answers(decided[which], row_of, single=isinstance(tree.actions, DiscreteActions))


@final
@dataclass(frozen=True)
class Table:
    """The inner nodes of a tree, in preorder, for a loop that begins with ``node = 0``.

    ``node = child[node][not (x[feature[node]] <= threshold[node])]`` while it is not negative; then ``~node`` is the
    row of the answer.
    """

    feature: list[int]
    threshold: list[float]
    child: list[tuple[int, int]]


def table(tree: BaseTree, rows: Answers) -> Table:
    """Number the inner nodes. There is at least one comparison, or no loop to be written."""
    inner = np.flatnonzero(~tree.is_leaf)
    number = np.where(tree.is_leaf, ~rows.row_of, np.cumsum(~tree.is_leaf) - 1)
    return Table(
        feature=tree.feature[inner].tolist(),
        threshold=[unflushed_threshold(t) for t in tree.threshold[inner]],
        child=list(
            zip(
                number[tree.children_left[inner]].tolist(),
                number[tree.children_right[inner]].tolist(),
                strict=True,
            )
        ),
    )


def branch_words(tree: BaseTree, step: Step) -> str:
    """Say when an ``if`` is entered: ``pole angle ≤ 0.021``, ``front is not lava``."""
    group = asked_group(tree, step.node)
    if group is not None:
        return group.words(int(tree.feature[step.node]), negated=step.side == "left")
    words = node_words(tree, step.node)
    return words if step.side == "left" else f"not {words}"


def comment(words: str) -> str:
    """Make words of strangers a part of a comment of one line in any language: ASCII, and nothing that ends it.

    What would end or begin a comment, a script or a trigraph is parted by a space: ``* /``, ``< /script>``.
    """
    ascii_words = printable(words.replace("≤", "<=")).encode("ascii", "backslashreplace").decode()
    parted = re.sub(r"(?<=[*/?])(?=[*/?>])|(?<=<)(?=[/!?a-zA-Z])|(?<=[-\]])(?=>)", " ", ascii_words)
    return parted + " " if parted.endswith("\\") else parted


def legend(tree: BaseTree) -> list[str]:
    """Return the inputs and outputs, a line each, for the comment at the head of a program."""
    lines = [f"x[{i}]: {comment(name)}" for i, name in enumerate(tree.feature_names)]
    actions = tree.actions
    if isinstance(actions, DiscreteActions):
        return lines + [
            f"action {actions.start + i}: {comment(name)}" for i, name in enumerate(actions.names)
        ]
    if isinstance(actions, BoxActions):
        return lines + [f"action[{i}]: {comment(name)}" for i, name in enumerate(actions.names)]
    parts = zip(actions.names, actions.start, actions.options, strict=True)
    return lines + [
        f"action[{i}]: {comment(name)}; "
        + comment(", ".join(f"{start + j} = {option}" for j, option in enumerate(options)))
        for i, (name, start, options) in enumerate(parts)
    ]


def variables(names: Sequence[str], reserved: Iterable[str]) -> list[str]:
    """A variable for each feature: ``pole_angle`` where the name gives one, short and its own, else ``x2``."""
    made = [re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") for name in names]
    taken = {*reserved}
    return [
        name if re.fullmatch(r"[a-z][a-z0-9_]{1,31}", name) and name not in taken and made.count(name) == 1
        # x0, x1, ... are positions, never names
        and not re.fullmatch(r"x\d+", name) else f"x{i}"
        for i, name in enumerate(made)
    ]  # fmt: skip


def check_name(name: str) -> str:
    """Return the name if functions of all languages can begin with it. Raises ValueError otherwise."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name):
        raise ValueError(
            f"a name must be a letter, then at most 62 letters, digits or _, all ASCII, got {name!r}; "
            "try 'policy'"
        )
    return name


def filled(items: Iterable[object], indent: str = "    ") -> str:
    """Write items with commas between them, as many a line as fit."""
    joined = ", ".join(map(str, items))
    return fill(
        joined,
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent,
        break_on_hyphens=False,
        break_long_words=False,
    )
