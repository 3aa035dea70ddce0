"""A rule on top of a tree, compared with an if in Python."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions
from sympol.trees.override import override

from .samples import (
    ACTIONS,
    consistent,
    every_cell,
    plain_leaf,
    random_grouped_tree,
    random_tree,
    telling_observations,
)

ANSWERS: dict[str, Any] = {"discrete": "right", "multi_discrete": ["on", "none"], "box": [[0.25], [-0.5]]}
# in quotes, because a bare x[0] would be read as it stands, too, but this is how strangers' names are written
CONDITIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    '"x[0]" <= 0.25': lambda x: x[:, 0] <= 0.25,
    '"x[0]" < 0.25': lambda x: x[:, 0] < 0.25,
    '"x[0]" > 0.25': lambda x: ~(x[:, 0] <= 0.25),
    '"x[0]" >= 0.25': lambda x: ~(x[:, 0] < 0.25),
    '"x[0]" > 0': lambda x: ~(x[:, 0] <= 0),
    '"x[0]" >= 0': lambda x: ~(x[:, 0] < 0),
    '"x[0]" < 0': lambda x: x[:, 0] < 0,
    '-0.5 < "x[1]" <= 0.5 and "x[2]" > 0': lambda x: (x[:, 1] > -0.5) & (x[:, 1] <= 0.5) & ~(x[:, 2] <= 0),
    '"x[0]" > 1 or "x[1]" < -1 and "x[2]" < 0': lambda x: ~(x[:, 0] <= 1) | ((x[:, 1] < -1) & (x[:, 2] < 0)),
    'not ("x[0]" > 0.25 or "x[1]" > 0.25)': lambda x: (x[:, 0] <= 0.25) & (x[:, 1] <= 0.25),
    '"x[0]" = 0.5': lambda x: x[:, 0] == 0.5,
    '"x[0]" > 0 and "x[0]" > 0.5 and "x[0]" > -3': lambda x: ~(x[:, 0] <= 0.5),
}


def flush(x: np.ndarray) -> np.ndarray:
    return np.where(np.abs(x) < 2.0**-126, np.float32(0), x)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_the_rule_holds_where_it_should_and_the_tree_elsewhere(condition: str):
    for kind in ACTIONS:
        for seed in range(4):
            rng = np.random.default_rng(seed)
            tree = random_tree(rng, ACTIONS[kind], depth=3)
            x = telling_observations(tree, rng, 600)
            edges = np.float32(
                [0.25, 0.5, -0.5, 1, -1, 0, -0.0, 1e-40, -1e-40, 1.1754944e-38, -1.1754944e-38, np.nan]
            )
            edges = np.concatenate(
                [edges, np.nextafter(edges, np.float32(9)), np.nextafter(edges, np.float32(-9))]
            )
            x = np.where(rng.random(x.shape) < 0.5, x, rng.choice(edges, x.shape)).astype(np.float32)
            edited, nodes = override(tree, condition, ANSWERS[kind])
            here = CONDITIONS[condition](flush(x))
            expected = tree.predict(x)
            expected[here] = edited.actions.decide(edited.value[[max(nodes)]])[0]
            assert here.any()
            np.testing.assert_array_equal(edited.predict(x), expected)
            its_leaves(edited, nodes, x, here)
            assert edited.feature_names == tree.feature_names
            assert edited.n_node_samples is None


def its_leaves(edited: DecisionTree, nodes: tuple[int, ...], x: np.ndarray, here: np.ndarray) -> None:
    """The rule's nodes are the way to its leaves, and exactly the forced observations end there."""
    leaves = {node for node in nodes if edited.is_leaf[node]}
    np.testing.assert_array_equal([plain_leaf(edited, row) in leaves for row in x], here)
    assert {edited.value[leaf].tobytes() for leaf in leaves} == {edited.value[min(leaves)].tobytes()}
    above = {0} if leaves else set()
    parents = {
        int(child): i
        for i in range(edited.n_nodes)
        for child in (edited.children_left[i], edited.children_right[i])
        if child > 0
    }
    for leaf in leaves:
        node = leaf
        while node:
            above.add(node)
            node = parents[node]
    assert above == set(nodes)


GROUPED: dict[str, Callable[[np.ndarray, Any], np.ndarray]] = {
    "g0 is c1": lambda x, g: x[:, g[0][1]] == 1,
    "g0 is not c1": lambda x, g: x[:, g[0][1]] == 0,
    "g0 is one of c0, c2": lambda x, g: x[:, g[0][1]] == 0,
    "g0 is neither c0 nor c2 and g1 is c0": lambda x, g: (x[:, g[0][1]] == 1) & (x[:, g[1][0]] == 1),
    "g0 is c1 or g1 is c0": lambda x, g: (x[:, g[0][1]] == 1) | (x[:, g[1][0]] == 1),
    "not (g0 is c0 and g1 is c1)": lambda x, g: (x[:, g[0][0]] == 0) | (x[:, g[1][1]] == 0),
}


@pytest.mark.parametrize("condition", GROUPED)
def test_rules_may_be_about_groups(condition: str):
    for kind in ACTIONS:
        for seed in range(6):
            tree = random_grouped_tree(np.random.default_rng(seed), ACTIONS[kind], depth=3)
            x = consistent(tree, every_cell(tree, nan=True))
            edited, nodes = override(tree, condition, ANSWERS[kind])
            here = GROUPED[condition](x, [group.features for group in tree.groups])
            expected = tree.predict(x)
            expected[here] = edited.actions.decide(edited.value[[max(nodes)]])[0]
            np.testing.assert_array_equal(edited.predict(x), expected)
            its_leaves(edited, nodes, x, here)


def test_whole_numbers_are_compared_as_they_are_written(cartpole):
    tree = replace(cartpole, integers=(1,))
    edited, nodes = override(tree, "cart velocity > 3", "push left")
    assert (edited.feature[0], edited.threshold[0]) == (1, 3)
    assert nodes == (0, edited.n_nodes - 1)
    x = np.zeros((4, 4), np.float32)
    x[:, 1] = [3, 4, -3, 3.5]
    np.testing.assert_array_equal(
        edited.predict(x) == 0, [cartpole.predict(x[0]) == 0, True, tree.predict(x[2]) == 0, True]
    )
    with pytest.raises(ValueError, match="no observation meets"):
        override(tree, "0.2 < cart velocity < 0.8", "push left")


def test_what_the_rule_decides_is_not_asked_again():
    tree = DecisionTree.from_text(
        "x ≤ 1\n yes: y ≤ 0\n  yes: a\n  no: b\n no: a",
        actions=DiscreteActions(2, ("a", "b")),
        feature_names=["x", "y"],
    )
    edited, nodes = override(tree, "x > 2", "b")
    assert edited.to_text() == (
        "x ≤ 2\n├─ yes: x ≤ 1\n│  ├─ yes: y ≤ 0\n│  │  ├─ yes: a\n│  │  └─ no:  b\n│  └─ no:  a\n└─ no:  b"
    )
    assert nodes == (0, 6)
    everything, nodes = override(tree, "x <= 0 or x > 0", "b")
    assert set(everything.predict(np.random.default_rng(0).normal(size=(50, 2)))) == {1}


def test_a_forced_rule_is_proven(cartpole):
    rule = "when pole angle > 0.1 and pole angular velocity > 0.5 then action is push left"
    assert not cartpole.verify(rule)[0].holds
    edited, _ = override(cartpole, "pole angle > 0.1 and pole angular velocity > 0.5", "push left")
    assert edited.verify(rule)[0].holds


@pytest.mark.parametrize(
    ("condition", "action", "message"),
    [
        ("pole angel > 0.1", 0, "unknown feature 'pole angel'; did you mean"),
        ("pole angle > 0.1", "push up", "unknown action 'push up'; did you mean"),
        ("pole angle > 0.1 and pole angle < 0", 0, "no observation meets the condition"),
        ("pole angle > ", 0, "expected a number"),
        ("pole angle >= -3.4028234663852886e38", 0, "a threshold must be finite"),
        (
            " or ".join(
                f"{name} = {i}"
                for i in range(10)
                for name in ("pole angle", "cart position", "cart velocity")
            ),
            0,
            "the condition asks more than 500 questions; split it",
        ),
    ],
)
def test_what_cannot_be_forced_is_said(cartpole, condition: str, action: Any, message: str):
    with pytest.raises(ValueError, match=message):
        override(cartpole, condition, action)


def test_many_cases_of_one_feature_are_no_more_than_they_are(cartpole):
    edited, nodes = override(cartpole, " or ".join(f"cart velocity = {i}" for i in range(60)), "push left")
    x = np.zeros((240, 4))
    x[:, 1] = np.arange(240) / 4
    np.testing.assert_array_equal(edited.predict(x), np.where(np.arange(240) % 4, cartpole.predict(x), 0))
    assert sum(edited.is_leaf[list(nodes)]) == 60
