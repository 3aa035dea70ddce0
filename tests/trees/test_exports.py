"""What is exported acts as the tree does, to the bit, wherever observations can tell."""

import ast
import dataclasses
import re
import subprocess
import sys

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group, MultiDiscreteActions
from sympol.trees.export.common import variables

from .samples import (
    ACTIONS,
    HOSTILE_NAMES,
    chain,
    consistent,
    every_cell,
    random_grouped_tree,
    random_tree,
    telling_observations,
)

unnamed = pytest.mark.filterwarnings("ignore:X does not have valid feature names:UserWarning")
"""scikit-learn says so where an estimator has names and an observation, being an array, has none."""


def program(tree: DecisionTree):
    """Run the exported program; return its act()."""
    namespace = {"__name__": "policy"}
    exec(compile(tree.to_python(), "policy.py", "exec"), namespace)
    return namespace["act"]


@pytest.mark.parametrize("kind", ACTIONS)
def test_python_acts_the_same(kind):
    rng = np.random.default_rng(3)
    for depth in (0, 1, 3, 6, 10):
        tree = random_tree(rng, ACTIONS[kind], depth=depth)
        x = telling_observations(tree, rng, 24_000)
        act = program(tree)
        acted = np.array([act(row) for row in x.tolist()])
        assert (acted == tree.predict(x).reshape(acted.shape)).all()


@pytest.mark.parametrize("kind", ACTIONS)
def test_sklearn_acts_the_same(kind):
    rng = np.random.default_rng(4)
    for depth in (0, 1, 3, 6, 10):
        tree = random_tree(rng, ACTIONS[kind], depth=depth)
        x = telling_observations(tree, rng, 40_000)
        estimator = tree.to_sklearn()
        assert (estimator.tree_.apply(x) == tree.apply(x)).all()
        x = x[np.isfinite(x).all(axis=1)]
        with np.errstate(invalid="ignore"):  # scikit-learn sums x, largest floats of both signs among it
            acted = estimator.predict(x)
        assert (acted == tree.predict(x).reshape(acted.shape)).all()
        assert len(x) > 10_000


@pytest.mark.parametrize("kind", ACTIONS)
def test_trees_over_groups_act_the_same(kind):
    rng = np.random.default_rng(8)
    for depth in (0, 1, 3, 6, 10):
        tree = random_grouped_tree(rng, ACTIONS[kind], depth, (4, 1, 3), 2)
        x = consistent(tree, every_cell(tree, nan=True))
        act = program(tree)
        acted = np.array([act(row) for row in x.tolist()])
        assert (acted == tree.predict(x).reshape(acted.shape)).all()
        estimator = tree.to_sklearn()
        assert (estimator.tree_.apply(x) == tree.apply(x)).all()
        x = x[np.isfinite(x).all(axis=1)]
        assert (estimator.predict(x).reshape(len(x), -1) == tree.predict(x).reshape(len(x), -1)).all()


def answer(policy, observation):
    try:
        return int(policy(observation))
    except ValueError as error:
        return (
            "refused" if re.search(r"must be a single 1 .* got \[.*\].* in .*\[.*\]", str(error)) else error
        )


def test_python_refuses_what_the_tree_refuses():
    rng = np.random.default_rng(9)
    # the program checks the groups also where it asks nothing
    for depth in (0, 3):
        tree = random_grouped_tree(rng, ACTIONS["discrete"], depth, (3, 2), 1)
        act, accepted = program(tree), 0
        x = rng.choice(consistent(tree, every_cell(tree, nan=False)), 2000).astype(np.float64)
        odd = rng.choice(
            [0, -0.0, 1, 1 + 1e-9, 1 + 1e-6, 1e-39, -1e-39, 1.2e-38, -1, 2, np.nan, np.inf], x.shape
        )
        for row in np.where(rng.random(x.shape) < 0.2, odd, x).tolist():
            expected = answer(tree.predict, row)
            assert answer(act, row) == expected
            accepted += expected != "refused"
        assert 200 < accepted < 1800


def named_group(name: str, *categories: str) -> DecisionTree:
    """Make a tree of two groups of one name, each with these categories, that asks about all of them."""
    n = len(categories)
    groups = [Group(name, tuple(range(i * n, (i + 1) * n)), categories) for i in (0, 1)]
    rng = np.random.default_rng(10)
    return DecisionTree.from_complete(
        rng.integers(2 * n, size=127),
        np.full(127, 0.5),
        np.eye(128),
        actions=DiscreteActions(128),
        feature_names=["x"] * 2 * n,
        groups=groups,
    )


def test_groups_of_one_name_and_categories_of_one_name_are_told_apart():
    for names in (("", "", "", ""), ("door", "a", "a (2)", "a", "a"), ("choice (2)", "b")):
        tree = named_group(*names)
        x = consistent(tree, every_cell(tree, nan=False))
        assert [program(tree)(row) for row in x] == tree.predict(x).tolist()


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_a_name_of_a_group_never_becomes_code(name):
    def shape(tree: DecisionTree) -> str:
        parsed = ast.parse(tree.to_python())
        for node in ast.walk(parsed):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                node.value = "x"
        return ast.dump(parsed)

    tree = named_group(name, name, "plain", name)
    source = tree.to_python()
    assert shape(tree) == shape(named_group("x", "x", "plain", "x"))
    assert source.encode("utf-8").count(b"\n") == named_group("x", "x", "plain", "x").to_python().count("\n")
    x = consistent(tree, every_cell(tree, nan=False))
    assert [program(tree)(row) for row in x] == tree.predict(x).tolist()


def test_an_action_has_python_s_own_type():
    rng = np.random.default_rng(0)
    kinds = {kind: type(program(random_tree(rng, actions))([0, 0, 0])) for kind, actions in ACTIONS.items()}
    assert kinds == {"discrete": int, "multi_discrete": tuple, "box": list}


def test_python_rounds_as_the_tree_does(cartpole):
    x = np.random.default_rng(0).normal(size=(1000, 4))
    x[:500, 3] = -0.05 + 1e-9 * x[:500, 3]
    act = program(cartpole)
    assert [act(row) for row in x] == cartpole.predict(x).tolist()
    assert act([0, 0, 0, 1e300]) == cartpole.predict([0, 0, 0, 1e300])


@pytest.mark.parametrize("observation", [[0.0] * 3, [0.0] * 5, []])
def test_python_checks_the_length(cartpole, observation):
    with pytest.raises(ValueError, match=r"expected 4 numbers .*pole angle"):
        program(cartpole)(observation)


@pytest.mark.parametrize("to_left", [True, False])
@pytest.mark.parametrize("depth", [90, 101, 2000])
def test_python_of_a_long_chain(to_left, depth):
    tree = chain(depth, to_left=to_left, actions=DiscreteActions(2))
    x = np.linspace(-depth - 1, depth + 1, 100)[:, None]
    act = program(tree)
    assert [act(row) for row in x] == tree.predict(x).tolist()
    # with a group there are elifs
    low, high = (np.append(bound, end) for bound, end in ((tree.feature_low, 0), (tree.feature_high, 1)))
    grouped = dataclasses.replace(
        tree,
        feature_names=("x", "always"),
        feature_low=low,
        feature_high=high,
        groups=(Group("", (1,), ("always",)),),
    )
    act = program(grouped)
    assert [act([row, 1]) for row in x[:, 0]] == tree.predict(x).tolist()


def test_python_runs_alone(cartpole, tmp_path):
    (tmp_path / "policy.py").write_text(cartpole.to_python(), encoding="utf-8")
    command = [sys.executable, "-I", "-S", "policy.py", "0", "0", "0", "0.1"]
    done = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert done.stdout == f"{cartpole.predict([0, 0, 0, 0.1])}\n"


@unnamed
@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_a_name_never_becomes_code(name):
    def named(name: str) -> DecisionTree:
        return DecisionTree.from_complete(
            np.array([0]),
            np.array([0.0]),
            np.eye(2, 4),
            actions=MultiDiscreteActions((2, 2), (name, name), ((name, name),) * 2),
            feature_names=[name],
        )

    def shape(name: str) -> str:
        parsed = ast.parse(named(name).to_python())
        (variable,) = variables([name], ())
        for node in ast.walk(parsed):
            if isinstance(node, ast.Constant) and node.value == name:
                node.value = "x"
            if isinstance(node, ast.Name) and node.id == variable:
                node.id = "x0"
        return ast.dump(parsed)

    source = named(name).to_python()
    assert shape(name) == shape("x")
    assert source.encode("utf-8").count(b"\n") == named("x").to_python().count("\n")
    assert named(name).to_sklearn().predict([[0.0]]).tolist() == [[0, 0]]


@unnamed
def test_sklearn_probabilities_and_tools(cartpole):
    from sklearn.tree import export_text
    from sklearn.utils.validation import check_is_fitted

    estimator = cartpole.to_sklearn()
    check_is_fitted(estimator)
    x = np.random.default_rng(0).normal(size=(100, 4))
    assert np.allclose(estimator.predict_proba(x), cartpole.predict_proba(x))
    assert (estimator.get_depth(), estimator.get_n_leaves()) == (cartpole.depth, cartpole.n_leaves)
    assert estimator.classes_.tolist() == [0, 1]
    assert "pole angle <= 0.02" in export_text(estimator, feature_names=list(cartpole.feature_names))


@unnamed
def test_sklearn_keeps_an_action_whose_probability_ties():
    tree = DecisionTree.from_complete(
        np.zeros(0, int),
        np.zeros(0),
        np.array([[0.0, 1e-30]]),
        actions=DiscreteActions(2),
        feature_names=["x"],
    )
    assert tree.to_sklearn().predict([[0.0]]).tolist() == tree.predict([[0.0]]).tolist() == [1]
