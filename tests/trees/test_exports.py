"""What is exported acts as the tree does, to the bit, wherever observations can tell."""

import ast
import subprocess
import sys

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, MultiDiscreteActions

from .samples import ACTIONS, HOSTILE_NAMES, chain, random_tree, telling_observations


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


def test_python_runs_alone(cartpole, tmp_path):
    (tmp_path / "policy.py").write_text(cartpole.to_python(), encoding="utf-8")
    command = [sys.executable, "-I", "-S", "policy.py", "0", "0", "0", "0.1"]
    done = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert done.stdout == f"{cartpole.predict([0, 0, 0, 0.1])}\n"


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

    source = named(name).to_python()
    plain = ast.dump(ast.parse(named("x").to_python()))
    assert ast.dump(ast.parse(source)).replace(f"Constant(value={name!r})", "Constant(value='x')") == plain
    assert source.encode("utf-8").count(b"\n") == named("x").to_python().count("\n")
    assert named(name).to_sklearn().predict([[0.0]]).tolist() == [[0, 0]]


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


def test_sklearn_keeps_an_action_whose_probability_ties():
    tree = DecisionTree.from_complete(
        np.zeros(0, int),
        np.zeros(0),
        np.array([[0.0, 1e-30]]),
        actions=DiscreteActions(2),
        feature_names=["x"],
    )
    assert tree.to_sklearn().predict([[0.0]]).tolist() == tree.predict([[0.0]]).tolist() == [1]


def test_without_sklearn_the_error_names_the_remedy(cartpole, monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.tree", None)
    with pytest.raises(ImportError, match=r"pip install 'sympol\[sklearn\]'"):
        cartpole.to_sklearn()
