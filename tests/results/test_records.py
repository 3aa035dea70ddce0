"""Dataclasses as JSON: what is written is read, and everything else is refused by its name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from sympol.results.records import from_fields, to_fields
from sympol.trees import DecisionTree
from sympol.trees.actions import DiscreteActions


@dataclass(frozen=True)
class Part:
    FORMER_NAMES: ClassVar[Mapping[str, str]] = {"old": "new"}

    new: int


@dataclass(frozen=True)
class Whole:
    parts: tuple[Part, ...]
    text: str
    share: float
    folder: Path
    best: Mapping[int, float]
    options: Mapping[str, Any]
    is_done: bool
    limit: int | None = None


WHOLE = Whole(
    (Part(1), Part(2)), "x", 0.5, Path("a/b"), {3: 1.5, 5: -2.0}, {"size": 3, "deep": [1]}, True, None
)


def test_what_is_written_is_read_again():
    assert from_fields(Whole, json.loads(json.dumps(to_fields(WHOLE)))) == WHOLE


def test_a_tree_is_read_to_the_bit():
    @dataclass(frozen=True)
    class Holder:
        tree: DecisionTree

    Holder.__annotations__["tree"] = DecisionTree
    values = np.array([[1.0, 0.0], [0.0, 1.0]])
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([0.1]), values, actions=DiscreteActions(2), feature_names=("x",),
        feature_low=np.full(1, -np.inf), feature_high=np.full(1, np.inf),
    )  # fmt: skip
    assert from_fields(Holder, json.loads(json.dumps(to_fields(Holder(tree))))).tree == tree


def test_former_names_are_read():
    assert from_fields(Part, {"old": 4}) == Part(4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"speed": 3}, "Whole has unknown fields speed"),
        ({"parts": [{"new": "1"}]}, "new must be of type int, got '1'"),
        ({"parts": [{"new": True}]}, "new must be of type int, got True"),
        ({"parts": [{}]}, "Part has missing fields new"),
        ({"parts": [3]}, "Part must be an object, got 3"),
        ({"parts": 3}, "parts must be of type"),
        ({"text": None}, "text must be of type str, got None"),
        ({"share": "half"}, "share must be of type float"),
        ({"folder": 3}, "folder must be of type Path"),
        ({"best": [1]}, "best must be of type"),
        ({"is_done": 1}, "is_done must be of type bool, got 1"),
        ({"limit": 1.5}, "limit must be of type int"),
    ],
)
def test_other_fields_are_refused_by_name(change, words):
    with pytest.raises(ValueError, match=words):
        from_fields(Whole, {**to_fields(WHOLE), **change})


def test_a_missing_field_is_refused_even_if_it_has_a_default():
    content = to_fields(WHOLE)
    del content["limit"], content["text"]
    with pytest.raises(ValueError, match="Whole has missing fields limit, text"):
        from_fields(Whole, content)


def test_what_json_cannot_hold_is_refused():
    with pytest.raises(ValueError, match="plain values"):
        to_fields(Whole((), "x", 0.5, Path(), {}, {"object": object()}, True))
