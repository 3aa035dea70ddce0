"""The parser of trees as text: what `to_text` writes, and the same written by hand.

    pole angle ≤ 0.02
    ├─ yes: push left
    └─ no:  pole angular velocity ≤ -0.2
       ├─ yes: push left
       └─ no:  push right

The lines that connect nodes may be left out: only the indentation of ``yes:`` and ``no:`` counts, in either order.
Questions are ``NAME ≤ NUMBER`` (or ``<=``, ``<``, ``≥``, ``>=``, ``>``) and, for groups, ``front is lava`` (or ``front
is not lava``); actions are written as the tree writes them. Numbers are rounded to float32.

A listing does not tell the order of the features, nor all actions. Another tree does, or the caller, or a header in
the text, which is TOML between two lines ``+++``:

    +++
    features = ["cart position", "cart velocity", "pole angle", "pole angular velocity"]
    actions = ["push left", "push right"]
    +++
    pole angle <= 0.02
      yes: push left
      no: push right

The header's ``features``, ``groups``, ``actions`` and ``meta`` are those of the JSON (docs/guides/tree-json.md), where
a feature may be just its name and discrete actions just a list of theirs.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..bounded import LARGEST_BY_HAND, parse_toml
from .actions import ActionSpec, BoxActions, DiscreteActions, MultiDiscreteActions
from .base import BaseTree, TreeT
from .edit import checked_threshold, leaf_tree
from .floats import brief, next_below, printable
from .name_lookup import did_you_mean, leaf_value, position
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD
from .regions import Way
from .serialize import FORMAT, VERSION, from_json, read_actions

if TYPE_CHECKING:
    from jaxtyping import Float32

FENCE = "+++"
_LABELLED = re.compile(r"([ │├└─|+`\\-]*)(yes|no):(.*)", re.IGNORECASE)
_SHARE = re.compile(r"(?<! ) {2,}[<>]?[0-9]{1,3} %$")


_NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_COMPARISON = re.compile(rf"(.*)(≤|<=|≥|>=|<|>)\s*({_NUMBER})")
CATEGORY = 0.5
"""The threshold between the 0 and the 1 of a feature in a group; any from 0 to below 1 asks the same."""


class Document(NamedTuple):
    """A text parted into its header and its listing."""

    header: dict[str, Any]
    """The content of the TOML header; empty if there is none."""
    lines: list[str]
    """The lines of the listing."""
    n_skipped: int
    """The number of lines before the listing."""


@dataclass(eq=False)
class _Line:
    """A node as written: its line number, its indentation, its question or action, and its children by yes and no."""

    number: int
    column: int
    words: str
    children: dict[str, _Line] = field(default_factory=dict)


def from_text(
    text: str,
    kind: type[TreeT],
    *,
    like: TreeT | None = None,
    actions: ActionSpec | None = None,
    **space: Any,
) -> TreeT:
    """Parse a tree; it acts on every observation as the tree that `to_text` wrote, with the same thresholds.

    The text does not hold visits, nor the values of leaves beyond their actions (see
    `sympol.trees.name_lookup.leaf_value`), nor digits that were not written.

    Args:
        text: The listing, with or without a header.
        kind: The class of the tree.
        like: A tree of the same features and actions, if the text has no header.
        actions: The actions, if there is neither a header nor such a tree.
        space: With ``actions``, the observations: feature_names and what else `DecisionTree.from_complete` takes.

    Raises:
        ValueError: If the text is not a tree, naming the line, or nothing tells its features and actions.
    """
    document = parse_document(text)
    known = _space(document.header, kind, like, actions, space)
    splits: list[Split | None] = []
    values: list[np.ndarray] = []
    stack = [_outline(document)]
    while stack:
        line = stack.pop()
        try:
            splits.append(parse_question(known, line.words) if line.children else None)
            values.append(_leaf_value(known, line))
        except ValueError as error:
            raise ValueError(f"line {line.number}: {error}") from None
        if (split := splits[-1]) is not None:
            sides = line.children["yes"], line.children["no"]
            stack += sides if split.yes == "right" else sides[::-1]
    return _assembled(known, splits, values)


def parse_document(text: str) -> Document:
    """Part a text into its header and its listing.

    Raises:
        ValueError: If the header is not TOML, or has an unknown key.
    """
    lines = text.removeprefix("\ufeff").replace("\r\n", "\n").split("\n")
    first = next((i for i, line in enumerate(lines) if line.strip()), 0)
    fences = [i for i, line in enumerate(lines) if line.strip() == FENCE]
    if len(fences) < 2 or fences[0] != first:
        return Document({}, lines, 0)
    written = "\n".join(lines[first + 1 : fences[1]])
    content = parse_toml(written, "the header", f", between {FENCE} and {FENCE},", LARGEST_BY_HAND)
    if unknown := content.keys() - {"features", "actions", "groups", "meta", "env"}:
        raise ValueError(
            f"the header has an unknown key {brief(sorted(unknown)[0])}; it may have features, actions, groups, meta "
            "and env"
        )
    return Document(content, lines[fences[1] + 1 :], fences[1] + 1)


def _space(
    header: dict[str, Any],
    kind: type[TreeT],
    like: TreeT | None,
    actions: ActionSpec | None,
    space: dict[str, Any],
) -> TreeT:
    """Return a tree of one leaf with the features and actions of the text."""
    meta = _meta(header)
    if "features" in header or "actions" in header:
        if "features" not in header or "actions" not in header:
            raise ValueError("the header must have both features and actions, or only env")
        return _declared(header, meta, kind)
    if actions is not None:
        nothing = np.zeros(0)
        known = kind.from_complete(
            nothing.astype(int), nothing, np.zeros((1, actions.n_outputs)), actions=actions, **space
        )
    elif like is not None:
        known = leaf_tree(like, np.zeros(like.actions.n_outputs, np.float32))
    else:
        raise ValueError(
            "nothing says which features and actions there are: give like=, a tree of the same, or actions= and "
            f"feature_names=, or start the text with a header between two lines {FENCE} that lists features and "
            "actions (a header that only names an env is for commands)"
        )
    return replace(known, meta={**known.meta, **meta})


def _meta(header: dict[str, Any]) -> dict[str, Any]:
    """Return the header's ``meta`` and ``env`` as plain JSON."""
    meta = header.get("meta", {})
    if not isinstance(meta, dict):
        raise ValueError(f"the header: meta must be a table, got {brief(meta)}")
    try:
        both = {**meta, **({"env": header["env"]} if "env" in header else {})}
        return json.loads(json.dumps(_finite(both), allow_nan=False))
    except (ValueError, TypeError) as error:
        raise ValueError(f"the header: {error}") from error


def _declared(header: dict[str, Any], meta: dict[str, Any], kind: type[TreeT]) -> TreeT:
    """Return a tree of one leaf with the features and actions of the header."""
    try:
        actions = header["actions"]
        if isinstance(actions, list):
            actions = {"type": "discrete", "start": 0, "names": actions}
        n_outputs = read_actions(_finite(actions)).n_outputs
        features = header["features"]
        document = {
            "format": FORMAT,
            "version": VERSION,
            "features": [*map(_feature, features)] if isinstance(features, list) else features,
            "actions": actions,
            "nodes": [{"value": [0] * n_outputs}],
            "meta": meta,
        }
        if "groups" in header:
            document["groups"] = [{"cell": None, **g} if isinstance(g, dict) else g for g in header["groups"]]
        return from_json(json.dumps(_finite(document), allow_nan=False), kind)
    except (ValueError, TypeError) as error:
        raise ValueError(f"the header: {error}") from error


def _feature(given: Any) -> Any:
    if isinstance(given, str):
        given = {"name": given}
    return {"low": -math.inf, "high": math.inf, **given} if isinstance(given, dict) else given


def _finite(given: Any) -> Any:
    """Return the same with infinities as the JSON writes them."""
    if isinstance(given, dict):
        return {name: _finite(value) for name, value in given.items()}
    if isinstance(given, list):
        return [*map(_finite, given)]
    return str(given) if isinstance(given, float) and math.isinf(given) else given


def _outline(document: Document) -> _Line:
    """Return the root of the listing, its lines nested by indentation alone."""
    lines = ((i, line.rstrip()) for i, line in enumerate(document.lines, document.n_skipped + 1))
    written = [(i, line) for i, line in lines if line]
    number, words = written[0] if written else (document.n_skipped + 1, "")
    root = _Line(number, -1, words.strip())
    above = [root]
    for number, words in written[1:]:
        line, label = _labelled(number, words)
        while above[-1].column >= line.column:
            above.pop()
        parent = above[-1]
        if label in parent.children:
            raise ValueError(
                f"line {number}: a second {label}: below line {parent.number}, {brief(parent.words)}; check the "
                "indentation"
            )
        if any(other.column != line.column for other in parent.children.values()):
            raise ValueError(
                f"line {number}: yes and no below line {parent.number} must be indented alike, got "
                f"{next(iter(parent.children.values())).column} and {line.column}"
            )
        parent.children[label] = line
        above.append(line)
    for line in _all(root):
        if len(line.children) == 1:
            missing = "no" if "yes" in line.children else "yes"
            raise ValueError(f"line {line.number}: {brief(line.words)} lacks {missing}: below it")
    return root


def _labelled(number: int, words: str) -> tuple[_Line, str]:
    found = _LABELLED.fullmatch(words)
    if found is None:
        tab = "a tab, whose width is unknown; indent with spaces"
        what = tab if "\t" in words else brief(words.strip())
        raise ValueError(f"line {number}: expected yes: or no:, got {what}")
    indent, label, words = found.groups()
    return _Line(number, len(indent), words.strip()), label.lower()


def _all(root: _Line) -> Iterator[_Line]:
    stack = [root]
    while stack:
        yield (line := stack.pop())
        stack += line.children.values()


def _leaf_value(known: BaseTree, line: _Line) -> np.ndarray:
    if line.children:
        return np.zeros(known.actions.n_outputs, np.float32)
    try:
        return parse_action(known, line.words)
    except ValueError:
        if without := _SHARE.sub("", line.words):
            return parse_action(known, without.rstrip())
        raise


def _assembled(known: TreeT, splits: list[Split | None], values: list[np.ndarray]) -> TreeT:
    """Return the tree of these nodes, which are in preorder."""
    right = np.full(len(splits), NO_CHILD)
    roots: list[int] = []
    for node in reversed(range(len(splits))):
        if splits[node] is not None:
            roots.pop()
            right[node] = roots.pop()
        roots.append(node)
    return replace(
        known,
        children_left=[NO_CHILD if one is None else node + 1 for node, one in enumerate(splits)],
        children_right=right,
        feature=[NO_FEATURE if one is None else one.feature for one in splits],
        threshold=[NO_THRESHOLD if one is None else one.threshold for one in splits],
        value=np.stack(values),
    )


class Split(NamedTuple):
    """A question as a split, and the side of yes."""

    feature: int
    threshold: float
    yes: Way


def parse_question(tree: BaseTree, words: str) -> Split:
    """Parse the question of an inner node.

    Args:
        tree: A tree with the features and groups that it may name.
        words: The question, such as ``pole angle ≤ 0.02`` or ``front is not lava``.

    Raises:
        ValueError: If it is not a question about these features, or can be read in two ways.
    """
    compared = _COMPARISON.fullmatch(words)
    found = {*_categories(tree, words, negated=False)} or {*_categories(tree, words, negated=True)}
    if compared is not None:
        name, sign, number = compared.groups()
        names = [printable(one) for one in tree.feature_names]
        if not found or name.strip() in map(str.strip, names):
            found.add(_comparison(position(name.strip(), names, "feature"), sign, float(number)))
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


def _comparison(feature: int, sign: str, number: float) -> Split:
    """Return the split that compares a feature with a number, exactly, in float32.

    A tree knows only ``≤``: less than a number is at most the next float32 below it. ``>`` and ``≥`` are the opposites
    of ``≤`` and ``<``, so NaN meets them.
    """
    threshold = checked_threshold(number)
    if sign in ("<", ">=", "≥"):
        threshold = checked_threshold(float(next_below(threshold)))
    return Split(feature, threshold, "left" if sign in ("≤", "<=", "<") else "right")


def parse_action(tree: BaseTree, words: str) -> Float32[np.ndarray, " outputs"]:
    """Parse the action of a leaf.

    Args:
        tree: A tree with the actions that it may name.
        words: The action, such as ``push left``, ``gas: on, steer: left`` or ``torque = 0.5``.

    Returns:
        The value of a leaf with this action.

    Raises:
        ValueError: If it is not an action of the tree, or can be read in two ways.
    """
    actions = tree.actions
    if isinstance(actions, DiscreteActions):
        names = [printable(name) for name in actions.names]
        return leaf_value(actions, actions.start + position(words, names, "action"))
    found = _parts(actions, words)
    if len(found) != 1:
        example = ", ".join(actions.words(tree.leaf_actions[0]))
        how = (
            f"can be read in {len(found)} ways" if found else f"is not an action; write it as in {example!r}"
        )
        raise ValueError(f"{brief(words)} {how}")
    return leaf_value(actions, found[0])


def _categories(tree: BaseTree, words: str, *, negated: bool) -> Iterator[Split]:
    for group in tree.groups:
        for feature in group.features:
            if group.words(feature, negated=negated).strip() == words:
                yield Split(feature, CATEGORY, "left" if negated else "right")


def _parts(actions: MultiDiscreteActions | BoxActions, words: str) -> list[list[float]]:
    """Return the ways to read ``gas: on, steer: left`` or ``gas = 0.5, steer = -1``; of many, only some."""
    # for each position that the components so far can end at: the values that lead there
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
    """Yield the values of one component that the words may start with, and the text of each."""
    # blanks before a component have been skipped
    name = printable(actions.names[k]).lstrip()
    if isinstance(actions, BoxActions):
        if found := re.match(rf"{re.escape(name)}\s*=\s*({_NUMBER})", words):
            yield float(found[1]), found[0]
        return
    for i, option in enumerate(actions.options[k]):
        text = f"{name}: {printable(option)}".lstrip()
        for spelling in (text, text.rstrip()):
            if words.startswith(spelling):
                yield actions.start[k] + i, spelling
                break
