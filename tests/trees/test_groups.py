"""Groups: what they may be, and which observations a tree that has them refuses."""

import dataclasses

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group


@pytest.fixture
def lights() -> DecisionTree:
    return DecisionTree.from_complete(
        np.array([2]),
        np.array([0.5]),
        np.eye(2),
        actions=DiscreteActions(2, ("stop", "go")),
        feature_names=["red", "speed", "green", "night"],
        groups=[Group("light", (0, 2), ("red", "green")), Group("", (3,), ("always",))],
    )


@pytest.mark.parametrize(
    ("group", "message"),
    [
        (("g", (), ()), "different positions"),
        (("g", (1, 1), ("a", "b")), "different positions"),
        (("g", (-1,), ("a",)), "different positions"),
        (("g", (1,), ()), "a category, a string, for each of its 1 features"),
        (("g", (1,), (3,)), "a category, a string"),
        ((3, (1,), ("a",)), "a category, a string"),
        (("g", (1,), ("a",), (-1, 0)), "from 0 to 999"),
        (("g", (1,), ("a",), (0, 1000)), "from 0 to 999"),
    ],
)
def test_what_is_no_group_is_refused(group, message):
    with pytest.raises(ValueError, match=message):
        Group(*group)


def test_groups_that_do_not_fit_a_tree_are_refused(lights):
    with pytest.raises(ValueError, match="has feature 4, but there are 4 features"):
        dataclasses.replace(lights, groups=[Group("g", (4,), ("a",))])
    with pytest.raises(ValueError, match="feature 2 is in two groups, 'light' and 'other'"):
        dataclasses.replace(lights, groups=[*lights.groups, Group("other", (2,), ("a",))])


def test_equality_knows_groups(lights):
    assert lights != dataclasses.replace(lights, groups=())
    assert lights == dataclasses.replace(lights, groups=list(lights.groups))
    assert hash(lights) == hash(dataclasses.replace(lights))
    assert lights.group_of == {0: lights.groups[0], 2: lights.groups[0], 3: lights.groups[1]}


def test_words():
    group = Group("front\n", (1, 2), ("lava\n", "wall"))
    assert group.words(1) == r"front\n is lava\n"
    assert group.words(2, negated=True) == r"front\n is not wall"
    assert group.words_without((2,)) == r"front\n is not wall"
    assert group.words_without((1, 2)) == r"front\n is neither lava\n nor wall"
    nameless = Group("", (1, 2), ("day", "night"))
    assert [nameless.words(1), nameless.words(2, negated=True)] == ["day", "not night"]


def test_an_observation_is_refused_where_a_group_is_not_one_hot(lights):
    assert lights.predict([[1, 7, 0, 1], [1e-39, np.nan, 1 + 1e-9, 1], [-0.0, 0, 1, 1]]).tolist() == [0, 1, 1]
    assert lights.predict([0, np.inf, 1, 1]) == 1
    for wrong in (
        [0, 5, 0, 1],
        [1, 5, 1, 1],
        [0.5, 5, 0.5, 1],
        [2, 5, -1, 1],
        [np.nan, 5, 1, 1],
        [np.inf, 5, 0, 1],
    ):
        with pytest.raises(
            ValueError, match=r"group 'light' must be a single 1 .* \['red', 'green'\] in .* 5.0, "
        ):
            lights.predict([[1, 0, 0, 1], wrong])
        with pytest.raises(ValueError, match="group 'light'"):
            lights.decision_path(wrong)
    with pytest.raises(ValueError, match=r"group '' must be a single 1 .* got \[0.0\]"):
        lights.with_visits([[1, 0, 0, 0]])
