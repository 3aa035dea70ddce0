import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions
from sympol.trees.layout import levels, tidy
from sympol.trees.plot import MOST_NODES

from .samples import ACTIONS, HOSTILE_NAMES, chain, random_tree


@pytest.mark.parametrize("depth", [0, 1, 3, 6])
def test_nodes_never_overlap(depth):
    rng = np.random.default_rng(0)
    for _ in range(10):
        tree = random_tree(rng, ACTIONS["discrete"], depth=depth).prune()
        size = rng.uniform(0.1, 2, tree.n_nodes)
        x = tidy(tree, size, gap=0.1)
        assert (x - size / 2).min() == pytest.approx(0)
        for level in range(tree.depth + 1):
            here = np.flatnonzero(tree.node_depth == level)  # preorder is from left to right
            assert (np.diff(x[here]) > (size[here[1:]] + size[here[:-1]]) / 2 + 0.1 - 1e-9).all()
        inner = np.flatnonzero(~tree.is_leaf)
        middle = (x[tree.children_left[inner]] + x[tree.children_right[inner]]) / 2
        assert np.allclose(x[inner], middle)
        y = levels(tree, size, gap=0.1)
        parent, child = (
            np.repeat(inner, 2),
            np.ravel([tree.children_left[inner], tree.children_right[inner]], "F"),
        )
        assert (y[child] - size[child] / 2 > y[parent] + size[parent] / 2).all()


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("suffix", ["svg", "pdf", "png"])
def test_pictures_are_saved_and_always_the_same(kind, suffix, tmp_path):
    tree = random_tree(np.random.default_rng(0), ACTIONS[kind], depth=2)
    first, second = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
    tree.plot(first)
    tree.plot(str(second))
    assert first.stat().st_size > 1000
    assert first.read_bytes() == second.read_bytes()


def test_no_global_state_is_touched(cartpole):
    import matplotlib

    before = dict(matplotlib.rcParams)
    cartpole.plot()
    assert dict(matplotlib.rcParams) == before


def test_plotting_does_not_import_pyplot():
    code = """if True:
        import sys, numpy
        from sympol.trees import DecisionTree, DiscreteActions
        stump = numpy.array([0]), numpy.array([0.0]), numpy.eye(2)
        DecisionTree.from_complete(*stump, actions=DiscreteActions(2)).plot()
        sys.exit("matplotlib.pyplot" in sys.modules)
    """
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_names_are_shown_verbatim(tmp_path):
    tree = DecisionTree.from_complete(
        np.arange(7),
        np.zeros(7),
        np.eye(8),
        actions=DiscreteActions(8, tuple(HOSTILE_NAMES)),
        feature_names=HOSTILE_NAMES,
    )
    figure = tree.plot(tmp_path / "tree.svg")
    shown = [text.get_text() for text in figure.axes[0].texts]
    assert HOSTILE_NAMES[3] in shown  # mathtext
    assert "line\\nbreak\\r\\x0c\\x0b\\x85\\u2028" in shown
    assert not any(element.tag.endswith("script") for element in ET.parse(tmp_path / "tree.svg").iter())


def test_long_names_do_not_blow_up_the_picture(cartpole):
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([0.0]), np.eye(2), actions=DiscreteActions(2), feature_names=["x" * 10_000]
    )
    assert max(tree.plot().get_size_inches()) < 10


def test_it_draws_on_given_axes(cartpole):
    from matplotlib.figure import Figure

    figure = Figure()
    left, _ = figure.subplots(1, 2)
    assert cartpole.plot(ax=left) is figure
    assert len(left.texts) > cartpole.n_nodes


def test_what_cannot_be_drawn_is_refused(cartpole, tmp_path):
    with pytest.raises(ValueError, match=r"\.svg, \.pdf or \.png"):
        cartpole.plot(tmp_path / "tree.gif")
    with pytest.raises(ValueError, match="prune the tree first"):
        chain(MOST_NODES, to_left=True, actions=DiscreteActions(2)).plot()
