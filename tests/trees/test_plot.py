import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group
from sympol.trees.plot import MOST_NODES, PathPictures, arrange
from sympol.trees.plot_boxes import INK
from sympol.trees.plot_grid_view import ViewBox, glyph
from sympol.trees.plot_layout import levels, tidy
from sympol.trees.text import question

from .samples import ACTIONS, HOSTILE_NAMES, chain, random_tree

OBJECTS = ("unseen", "empty", "wall", "floor", "door", "key", "ball", "box", "goal", "lava", "agent")


def sees(categories: tuple[str, ...], cell: tuple[int, int] | None, asked: int = 0) -> DecisionTree:
    """A stump that asks what is in a cell."""
    n = len(categories)
    return DecisionTree.from_complete(
        np.array([asked]),
        np.array([0.5]),
        np.eye(2),
        actions=DiscreteActions(2, ("turn left", "forward")),
        feature_names=[f"front {i}" for i in range(n)],
        groups=[Group("front", tuple(range(n)), categories, cell=cell)],
    )


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


def test_right_children_first_is_the_mirror_image():
    rng = np.random.default_rng(0)
    tree = random_tree(rng, ACTIONS["discrete"], depth=5).prune()
    size = rng.uniform(0.1, 2, tree.n_nodes)
    x = tidy(tree, size, gap=0.1)
    mirrored = tidy(tree, size, 0.1, np.ones(tree.n_nodes, bool))
    assert np.allclose(mirrored, (x + size / 2).max() - x)


def test_yes_comes_first_whichever_child_it_is(front):
    for tree in (front, front.prune()):
        layout, _ = arrange(tree, digits=4)
        aside = layout.centre[:, 0 if layout.downward else 1]
        for node in np.flatnonzero(~tree.is_leaf):
            asked = question(tree, int(node))
            assert aside[asked.yes_child] < aside[asked.no_child]


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


def test_a_split_on_what_is_seen_shows_the_view(front, tmp_path):
    _, boxes = arrange(front, digits=4)
    views = [box for box in boxes if isinstance(box, ViewBox)]
    assert {(view.side, view.cell) for view in views} == {(2, (0, 1))}
    assert {view.words for view in views} == {"front is lava", "front is wall", "front is empty"}
    for path in (tmp_path / "a.svg", tmp_path / "b.svg"):
        figure = front.plot(path)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    shown = [text.get_text() for text in figure.axes[0].texts]
    assert {"front is lava", "speed", "↰ turn left", "↱ turn right", "↑ move forward"} <= {
        words.split("   ")[0] for words in shown
    }


def test_what_is_not_in_a_cell_is_said_in_words():
    figure = sees(("red", "green"), cell=None).plot()
    assert [text.get_text() for text in figure.axes[0].texts] == [
        "yes",
        "no",
        "front is red",
        "turn left",
        "forward",
    ]


@pytest.mark.parametrize("side", [1, 2, 3, 7, 40])
@pytest.mark.parametrize("category", [*OBJECTS, *HOSTILE_NAMES, "x" * 500])
def test_every_object_can_be_drawn_in_views_of_every_size(side, category):
    tree = sees(("other", category), cell=(side - 1, side // 2), asked=1)
    assert max(tree.plot().get_size_inches()) < 10


def test_objects_differ_by_their_form_alone():
    forms = {name: [line.points.tolist() for line in glyph(name)] for name in OBJECTS}
    assert [name for name, form in forms.items() if not form] == ["empty"]
    assert len({str(form) for form in forms.values()}) == len(OBJECTS)
    states = [
        str([line.points.tolist() for line in glyph(f"{state} door")])
        for state in ("open", "closed", "locked")
    ]
    assert len(set(states)) == 3


def test_objects_have_the_colours_they_are_said_to_have():
    red, green = glyph("red key"), glyph("Green key")
    assert len(red) == len(green) == len(glyph("key"))
    assert red[0].fill != green[0].fill
    assert glyph("locked red door")[0].fill == red[0].fill
    assert glyph("wet key") == glyph("crate") == glyph("") == ()


def test_the_way_of_an_observation_stands_out(front, cartpole):
    from matplotlib.colors import to_hex
    from matplotlib.patches import FancyBboxPatch

    def lit(tree: DecisionTree, x: np.ndarray | None) -> list[bool]:
        patches = tree.plot(highlight=x).axes[0].patches
        boxes = [
            p for p in patches if isinstance(p, FancyBboxPatch) and p.get_linewidth() and p.get_edgecolor()[3]
        ]
        return [to_hex(box.get_edgecolor()).upper() == INK for box in boxes]

    for category in np.eye(4):
        x = np.array([0.5, *category, 3])
        assert lit(front, x) == front.decision_path(x).tolist()
    assert lit(cartpole, np.zeros(4)) == cartpole.decision_path(np.zeros(4)).tolist()
    assert not any(lit(cartpole, None))
    sizes = {tuple(cartpole.plot(highlight=x).get_size_inches()) for x in (None, np.zeros(4), np.ones(4))}
    assert len(sizes) == 1
    with pytest.raises(ValueError, match="highlight must be one observation, got 2"):
        cartpole.plot(highlight=np.zeros((2, 4)))


def test_ways_are_drawn_over_the_pale_tree_as_a_picture_of_their_own_would_be(front, cartpole):
    import io

    from PIL import Image

    def apart(tree: DecisionTree, x: np.ndarray | None) -> np.ndarray:
        png = io.BytesIO()
        tree.plot(highlight=x).savefig(png, format="png", dpi=90)
        return np.asarray(Image.open(png).convert("RGB")).astype(int)

    for tree, observations in (
        (front, np.column_stack([np.zeros(4), np.eye(4), np.zeros(4)])),
        (cartpole, np.eye(4)),
    ):
        pictures = PathPictures(tree, most_pixels=(9000, 9000), dpi=90)
        for x in observations:
            way = pictures.path_to(int(tree.apply(x)))
            assert np.array_equal(way, pictures.path_to(int(tree.apply(x))))
            # the rims of the pale lines below shine through
            assert np.abs(way - apart(tree, x)).mean() < 0.3
            assert np.abs(way - apart(tree, None)).mean() > 3
        assert np.array_equal(pictures.whole(), apart(tree, None))


def test_ways_of_large_trees_fit_all_the_same():
    tree = random_tree(np.random.default_rng(0), ACTIONS["discrete"], depth=7)
    pictures = PathPictures(tree, most_pixels=(300, 200), dpi=90)
    height, width, _ = pictures.path_to(int(np.flatnonzero(tree.is_leaf)[0])).shape
    assert (width == 300 or height == 200, width <= 300, height <= 200) == (True, True, True)
    assert pictures.whole().shape == (height, width, 3)
