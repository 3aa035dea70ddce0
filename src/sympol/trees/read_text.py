"""Trees from text: what `to_text` writes, and the same written by hand.

    pole angle ≤ 0.02
    ├─ yes: push left
    └─ no:  pole angular velocity ≤ -0.2
       ├─ yes: push left
       └─ no:  push right

By hand the lines between may be left out: what counts is how far ``yes:`` and ``no:`` are indented, and which of
the two comes first does not. Questions are ``NAME ≤ NUMBER`` (or ``<=``, ``<``, ``≥``, ``>=``, ``>``) and, of
groups, ``front is lava`` (or ``front is not lava``); answers are as the tree writes them. Numbers are float32.

A listing does not say which features there are, in which order, and what the actions are. Another tree does, or
the caller, or the text itself in a header, which is TOML between two lines ``+++``:

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
from typing import Any, NamedTuple

import numpy as np

from ..bounded import LARGEST_BY_HAND, parse_toml
from .actions import ActionSpec
from .edit import leaf_tree
from .floats import brief
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD
from .reading import Asked, read_answer, read_question
from .serialize import FORMAT, VERSION, from_json, read_actions
from .tree import DecisionTree

FENCE = "+++"
_LABELLED = re.compile(r"([ │├└─|+`\\-]*)(yes|no):(.*)", re.IGNORECASE)
_SHARE = re.compile(r"(?<! ) {2,}[<>]?[0-9]{1,3} %$")


class Header(NamedTuple):
    """What stands before a listing."""

    content: dict[str, Any]
    """What the TOML says; empty without a header."""
    lines: list[str]
    """The listing's lines."""
    skipped: int
    """Lines before it."""


@dataclass(eq=False)
class _Line:
    """A node as it is written."""

    number: int
    column: int
    words: str
    below: dict[str, _Line] = field(default_factory=dict)


def from_text(
    text: str, *, like: DecisionTree | None = None, actions: ActionSpec | None = None, **space: Any
) -> DecisionTree:
    """Read a tree; it acts on every observation as the tree did that `to_text` wrote, and has the same thresholds.

    What a text does not hold is lost: visits, the leaves' values beyond the actions (see
    `sympol.trees.name_lookup.leaf_value`), and digits where it was written with fewer.

    Args:
        text: The listing, perhaps with a header.
        like: A tree of the same features and actions, where the text has no header.
        actions: What actions there are, where there is no such tree either.
        space: What observations there are, with ``actions``: feature_names and all else that
            `DecisionTree.from_complete` takes.

    Raises:
        ValueError: the text is no tree; the line is named. Or nothing says which features and actions there are.
    """
    header = read_header(text)
    known = _space(header.content, like, actions, space)
    root = _outline(header)
    nodes: list[_Line] = []
    asked: list[Asked | None] = []
    values: list[np.ndarray] = []
    awaited = [root]
    while awaited:
        nodes.append(line := awaited.pop())
        try:
            asked.append(read_question(known, line.words) if line.below else None)
            values.append(_answer(known, line))
        except ValueError as error:
            raise ValueError(f"line {line.number}: {error}") from None
        if (question := asked[-1]) is not None:
            sides = line.below["yes"], line.below["no"]
            awaited += sides if question.yes == "right" else sides[::-1]
    return _packed(known, asked, values)


def read_header(text: str) -> Header:
    """Part a text into its header and its listing.

    Raises:
        ValueError: the header is no TOML, or says what it cannot.
    """
    lines = text.removeprefix("\ufeff").replace("\r\n", "\n").split("\n")
    first = next((i for i, line in enumerate(lines) if line.strip()), 0)
    fences = [i for i, line in enumerate(lines) if line.strip() == FENCE]
    if len(fences) < 2 or fences[0] != first:
        return Header({}, lines, 0)
    written = "\n".join(lines[first + 1 : fences[1]])
    content = parse_toml(written, "the header", f", between {FENCE} and {FENCE},", LARGEST_BY_HAND)
    if unknown := content.keys() - {"features", "actions", "groups", "meta", "env"}:
        raise ValueError(
            f"the header says {brief(sorted(unknown)[0])}; it may say features, actions, groups, meta and env"
        )
    return Header(content, lines[fences[1] + 1 :], fences[1] + 1)


def _space(
    header: dict[str, Any], like: DecisionTree | None, actions: ActionSpec | None, space: dict[str, Any]
) -> DecisionTree:
    """A tree of one leaf that knows features and actions."""
    meta = _meta(header)
    if "features" in header or "actions" in header:
        if "features" not in header or "actions" not in header:
            raise ValueError("the header must say both features and actions, or only env")
        return _declared(header, meta)
    if actions is not None:
        nothing = np.zeros(0)
        known = DecisionTree.from_complete(
            nothing.astype(int), nothing, np.zeros((1, actions.n_outputs)), actions=actions, **space
        )
    elif like is not None:
        known = leaf_tree(like, np.zeros(like.actions.n_outputs, np.float32))
    else:
        raise ValueError(
            "nothing says which features and actions there are: give like=, a tree of the same, or actions= and "
            f"feature_names=, or begin the text with a header between two lines {FENCE}"
        )
    return replace(known, meta={**known.meta, **meta})


def _meta(header: dict[str, Any]) -> dict[str, Any]:
    """What the header says of the tree that is no part of it, as plain JSON."""
    meta = header.get("meta", {})
    if not isinstance(meta, dict):
        raise ValueError(f"the header: meta must be a table, got {brief(meta)}")
    try:
        said = {**meta, **({"env": header["env"]} if "env" in header else {})}
        return json.loads(json.dumps(_finite(said), allow_nan=False))
    except (ValueError, TypeError) as error:
        raise ValueError(f"the header: {error}") from error


def _declared(header: dict[str, Any], meta: dict[str, Any]) -> DecisionTree:
    try:
        given = header["actions"]
        if isinstance(given, list):
            given = {"type": "discrete", "start": 0, "names": given}
        n_outputs = read_actions(_finite(given)).n_outputs
        features = header["features"]
        document = {
            "format": FORMAT,
            "version": VERSION,
            "features": [*map(_feature, features)] if isinstance(features, list) else features,
            "actions": given,
            "nodes": [{"value": [0] * n_outputs}],
            "meta": meta,
        }
        if "groups" in header:
            document["groups"] = [{"cell": None, **g} if isinstance(g, dict) else g for g in header["groups"]]
        return from_json(json.dumps(_finite(document), allow_nan=False))
    except (ValueError, TypeError) as error:
        raise ValueError(f"the header: {error}") from error


def _feature(given: Any) -> Any:
    if isinstance(given, str):
        given = {"name": given}
    return {"low": -math.inf, "high": math.inf, **given} if isinstance(given, dict) else given


def _finite(given: Any) -> Any:
    """The same with infinities as the JSON writes them."""
    if isinstance(given, dict):
        return {name: _finite(value) for name, value in given.items()}
    if isinstance(given, list):
        return [*map(_finite, given)]
    return str(given) if isinstance(given, float) and math.isinf(given) else given


def _outline(header: Header) -> _Line:
    """What is below what, by indentation alone."""
    lines = ((i, line.rstrip()) for i, line in enumerate(header.lines, header.skipped + 1))
    written = [(i, line) for i, line in lines if line]
    number, words = written[0] if written else (header.skipped + 1, "")
    root = _Line(number, -1, words.strip())
    above = [root]
    for number, words in written[1:]:
        line, label = _labelled(number, words)
        while above[-1].column >= line.column:
            above.pop()
        parent = above[-1]
        if label in parent.below:
            raise ValueError(
                f"line {number}: {label} is said twice below line {parent.number}, {brief(parent.words)}; mind the "
                "indentation"
            )
        if any(other.column != line.column for other in parent.below.values()):
            raise ValueError(
                f"line {number}: yes and no below line {parent.number} must be indented alike, got "
                f"{next(iter(parent.below.values())).column} and {line.column}"
            )
        parent.below[label] = line
        above.append(line)
    for line in _all(root):
        if len(line.below) == 1:
            missing = "no" if "yes" in line.below else "yes"
            raise ValueError(f"line {line.number}: {brief(line.words)} lacks {missing}: below it")
    return root


def _labelled(number: int, words: str) -> tuple[_Line, str]:
    found = _LABELLED.fullmatch(words)
    if found is None:
        tab = "a tab, which has no certain width; indent with spaces"
        what = tab if "\t" in words else brief(words.strip())
        raise ValueError(f"line {number}: expected yes: or no:, got {what}")
    indent, label, words = found.groups()
    return _Line(number, len(indent), words.strip()), label.lower()


def _all(root: _Line) -> Iterator[_Line]:
    awaited = [root]
    while awaited:
        yield (line := awaited.pop())
        awaited += line.below.values()


def _answer(known: DecisionTree, line: _Line) -> np.ndarray:
    if line.below:
        return np.zeros(known.actions.n_outputs, np.float32)
    try:
        return read_answer(known, line.words)
    except ValueError:
        if without := _SHARE.sub("", line.words):
            return read_answer(known, without.rstrip())
        raise


def _packed(known: DecisionTree, asked: list[Asked | None], values: list[np.ndarray]) -> DecisionTree:
    """The tree of these nodes, which are in preorder."""
    right = np.full(len(asked), NO_CHILD)
    roots: list[int] = []
    for node in reversed(range(len(asked))):
        if asked[node] is not None:
            roots.pop()
            right[node] = roots.pop()
        roots.append(node)
    return replace(
        known,
        children_left=[NO_CHILD if one is None else node + 1 for node, one in enumerate(asked)],
        children_right=right,
        feature=[NO_FEATURE if one is None else one.feature for one in asked],
        threshold=[NO_THRESHOLD if one is None else one.threshold for one in asked],
        value=np.stack(values),
    )
