"""One line of a listing as a question or an answer: the other way round from `sympol.trees.text`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from .actions import BoxActions, DiscreteActions, MultiDiscreteActions
from .base import BaseTree
from .edit import checked_threshold
from .floats import brief, next_below, printable
from .name_lookup import did_you_mean, leaf_value, position
from .regions import Way

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float32

_NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_COMPARISON = re.compile(rf"(.*)(≤|<=|≥|>=|<|>)\s*({_NUMBER})")
CATEGORY = 0.5
"""The threshold between the 0 and the 1 of a feature in a group; any from 0 to below 1 asks the same."""


class Asked(NamedTuple):
    """A question: the split that asks it, and where yes is."""

    feature: int
    threshold: float
    yes: Way


def read_question(tree: BaseTree, words: str) -> Asked:
    """Read what an inner node asks.

    Raises:
        ValueError: it asks for nothing that the tree sees, or it can be read in two ways.
    """
    compared = _COMPARISON.fullmatch(words)
    found = {*_categories(tree, words, negated=False)} or {*_categories(tree, words, negated=True)}
    if compared is not None:
        name, sign, number = compared.groups()
        names = [printable(one) for one in tree.feature_names]
        if not found or name.strip() in map(str.strip, names):
            found.add(compare(position(name.strip(), names, "feature"), sign, float(number)))
    if len(found) > 1:
        raise ValueError(
            f"{brief(words)} can be read in {len(found)} ways; name features and categories apart"
        )
    if not found:
        known = [*tree.feature_names, *(g.words(f) for g in tree.groups for f in g.features)]
        raise ValueError(
            f"expected a question such as NAME ≤ NUMBER, got {brief(words)}; {did_you_mean(words, known)}"
        )
    return found.pop()


def compare(feature: int, sign: str, number: float) -> Asked:
    """Return the split that compares a feature with a number, exactly, in float32.

    A tree knows only ``≤``: less than a number is at most the next float32 below it. What is not less, NaN
    included, is ``≥`` and ``>``.

    Raises:
        ValueError: the number, or the one below it, is not finite in float32.
    """
    threshold = checked_threshold(number)
    if sign in ("<", ">=", "≥"):
        threshold = checked_threshold(float(next_below(threshold)))
    return Asked(feature, threshold, "left" if sign in ("≤", "<=", "<") else "right")


def read_answer(tree: BaseTree, words: str) -> Float32[np.ndarray, " outputs"]:
    """Read what a leaf does; return what it holds.

    Raises:
        ValueError: it is none of the actions, or it can be read in two ways.
    """
    actions = tree.actions
    if isinstance(actions, DiscreteActions):
        names = [printable(name) for name in actions.names]
        return leaf_value(actions, actions.start + position(words, names, "action"))
    found = _parts(actions, words)
    if len(found) != 1:
        example = ", ".join(actions.words(tree.leaf_actions[0]))
        how = f"can be read in {len(found)} ways" if found else f"is no action, which is such as {example!r}"
        raise ValueError(f"{brief(words)} {how}")
    return leaf_value(actions, found[0])


def _categories(tree: BaseTree, words: str, *, negated: bool) -> Iterator[Asked]:
    for group in tree.groups:
        for feature in group.features:
            if group.words(feature, negated=negated).strip() == words:
                yield Asked(feature, CATEGORY, "left" if negated else "right")


def _parts(actions: MultiDiscreteActions | BoxActions, words: str) -> list[list[float]]:
    """All ways, but of many only some, to read ``gas: on, steer: left`` or ``gas = 0.5, steer = -1``."""
    # from each place in the words that the components so far can reach: how they were read
    reached: dict[int, list[list[float]]] = {0: [[]]}
    for k in range(len(actions.names)):
        further: dict[int, list[list[float]]] = {}
        for at, ways in reached.items():
            for value, text in _component(actions, k, words[at:]):
                end = at + len(text)
                if k + 1 < len(actions.names):
                    comma = re.match(r",\s*", words[end:])
                    end = end + comma.end() if comma else -1
                elif words[end:].strip():
                    end = -1
                if end >= 0:
                    known = further.setdefault(end, [])
                    known += [[*way, value] for way in ways][: 2 - len(known)]
        reached = further
    return [way for ways in reached.values() for way in ways]


def _component(actions: MultiDiscreteActions | BoxActions, k: int, words: str) -> Iterator[tuple[float, str]]:
    """What the words may begin with, said of one component."""
    # whatever is blank before a component has been skipped
    name = printable(actions.names[k]).lstrip()
    if isinstance(actions, BoxActions):
        if found := re.match(rf"{re.escape(name)}\s*=\s*({_NUMBER})", words):
            yield float(found[1]), found[0]
        return
    for i, option in enumerate(actions.options[k]):
        text = f"{name}: {printable(option)}".lstrip()
        for said in (text, text.rstrip()):
            if words.startswith(said):
                yield actions.start[k] + i, said
                break
