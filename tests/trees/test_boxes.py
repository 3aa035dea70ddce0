"""The boxes of the leaves are the sets of observations that end in them, to the float32 and to the NaN."""

import dataclasses

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group
from sympol.trees.boxes import Boxes, leaf_boxes, node_boxes, space, unreachable_leaves
from sympol.trees.floats import SMALLEST_NORMAL, next_above, next_below, simplest_float

from .samples import ACTIONS, consistent, every_cell, random_grouped_tree, random_tree, telling_observations

SAMPLES = [(make, seed) for make in (random_tree, random_grouped_tree) for seed in range(20)]


def sample(make, seed) -> tuple[DecisionTree, np.ndarray]:
    rng = np.random.default_rng(seed)
    tree = make(rng, ACTIONS["discrete"])
    return tree, consistent(
        tree,
        np.concatenate([every_cell(tree, nan=True), telling_observations(tree, rng, 2000)]),
    )


@pytest.mark.parametrize(("make", "seed"), SAMPLES)
def test_every_observation_is_in_the_box_of_its_leaf_and_in_no_other(make, seed):
    tree, x = sample(make, seed)
    boxes = leaf_boxes(tree, bounds=False)
    assert (boxes.contains(x) == (np.flatnonzero(tree.is_leaf)[:, None] == tree.apply(x))).all()
    inside = space(tree, bounds=True).contains(x)[0]
    bounded = leaf_boxes(tree, bounds=True)
    assert (bounded.contains(x) == (boxes.contains(x) & inside)).all()


@pytest.mark.parametrize(("make", "seed"), SAMPLES)
def test_node_boxes_hold_those_whose_path_comes_by(make, seed):
    tree, x = sample(make, seed)
    assert (node_boxes(tree, bounds=False).contains(x) == tree.decision_path(x).T).all()


@pytest.mark.parametrize(("make", "seed"), SAMPLES)
@pytest.mark.parametrize("bounds", [False, True])
def test_some_observation_ends_in_its_leaf_and_empty_boxes_have_none(make, seed, bounds):
    tree, x = sample(make, seed)
    boxes = leaf_boxes(tree, bounds=bounds)
    for box, leaf in enumerate(np.flatnonzero(tree.is_leaf)):
        if boxes.is_empty[box]:
            assert not (boxes.contains(x)[box]).any()
            assert leaf in unreachable_leaves(tree, bounds=bounds)
            with pytest.raises(ValueError, match="empty"):
                boxes.some_observation(box)
        else:
            found = boxes.some_observation(box)
            assert tree.apply(found) == leaf
            assert space(tree, bounds=bounds).contains(found[None]).all()


def test_the_space_is_what_is_within_the_bounds():
    tree, x = sample(random_tree, 0)
    within = ((x >= tree.feature_low) & (x <= tree.feature_high)).all(axis=1)
    assert 0 < within.sum() < len(x)
    assert (space(tree, bounds=True).contains(x)[0] == within).all()
    assert space(tree, bounds=False).contains(x).all()


def test_whole_numbers_make_boxes_tight_and_empty():
    tree = DecisionTree.from_complete(
        np.array([0, 0, 0]),
        np.array([0.5, -0.5, 0.9]),
        np.eye(4),
        actions=DiscreteActions(4),
        integers=(0,),
    )
    boxes = leaf_boxes(tree, bounds=False)
    largest = np.finfo(np.float32).max
    assert boxes.low[:, 0].tolist() == [-largest, 0, 1, 1]
    assert boxes.high[:, 0].tolist() == [-1, 0, 0, largest]
    assert boxes.is_empty.tolist() == [False, False, True, False]
    assert not boxes.nan.any()
    assert unreachable_leaves(tree).tolist() == [np.flatnonzero(tree.is_leaf)[2]]
    assert len(unreachable_leaves(dataclasses.replace(tree, integers=()))) == 0


def test_of_a_group_exactly_one_is_left_in_the_end():
    group = Group("light", (0, 1, 2), ("red", "amber", "green"))
    cube = Boxes(np.zeros((3, 3), np.float32), np.ones((3, 3), np.float32), np.full((3, 3), False), (group,))
    low = np.float32([[0, 0, 0], [0, 1, 0], [1, 1, 0]])
    high = np.float32([[0, 0, 1], [1, 1, 1], [1, 1, 1]])
    cut = cube.intersect(Boxes(low, high, cube.nan))
    assert cut.low[:2].tolist() == cut.high[:2].tolist() == [[0, 0, 1], [0, 1, 0]]
    assert cut.is_empty.tolist() == [False, False, True]


def test_between_neighbours_there_is_nothing():
    numbers = np.float32([-np.inf, -1, -SMALLEST_NORMAL, -0.0, 0, SMALLEST_NORMAL, 0.1, 1])
    assert next_above(0.0) == np.float32(SMALLEST_NORMAL)
    assert next_above(-SMALLEST_NORMAL) == 0
    assert (next_below(next_above(numbers)) == numbers).all()
    assert (next_above(numbers) > numbers).all()


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-1, 1, 0),
        (0.1234, 7, 0.2),
        (-0.42, -0.021, -0.03),
        (0.1234, 0.13, 0.13),
        (12.5, np.inf, 20),
        (np.inf, np.inf, np.inf),
        (-np.inf, -3.0e38, -3.0e38),
    ],
)
def test_readable_numbers(low, high, expected):
    assert simplest_float(float(np.float32(low)), float(np.float32(high))) == np.float32(expected)


def test_readable_numbers_are_in_their_intervals():
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 2**32, 20_000, np.uint32).view(np.float32)
    ends = bits[~np.isnan(bits) & ~((np.abs(bits) < SMALLEST_NORMAL) & (bits != 0))]
    for x in ends.tolist():
        assert simplest_float(x, x) == x
        above = float(next_above(x))
        assert x <= simplest_float(x, above) <= above
    assert np.isnan(simplest_float(1, 0))
