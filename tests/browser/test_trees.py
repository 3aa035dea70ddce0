"""Trees of every kind and size are drawn, whatever things are called."""

from __future__ import annotations

import numpy as np

from sympol.trees import DecisionTree, DiscreteActions

from ..trees.samples import (
    ACTIONS,
    chain,
    random_tree,
)
from ..trees.test_report import HOSTILE, hostile_tree
from .looking import lit, near, pixels, shown, written


def test_a_strangers_names_stay_text(tab, tmp_path):
    tree = hostile_tree()
    page = tab.open(written(tree, tmp_path))
    assert page.locator("h1").text_content() == HOSTILE[8]
    assert page.title() == HOSTILE[8]
    assert page.locator("script").count() == 2
    assert page.locator("img, iframe, b").count() == 0
    labels = page.locator(".observation label[for]").all_text_contents()
    expected = {"*/ alert(1) /*", "`${alert(1)}`", "{{script}}", "__proto__", "&lt;b&gt;"}
    assert expected <= set(labels)
    everything = page.locator("body").text_content()
    assert "</svg><script>alert(1)</script>--> ]]>" in everything
    page.get_by_role("button", name="Unfold all").click()
    assert shown(page) == tree.n_nodes


def test_a_category_is_chosen_in_a_list_and_drawn_in_a_view(tab, tmp_path):
    from sympol.trees import Group

    tree = DecisionTree.from_complete(
        np.array([1, 0, 0]),
        np.float32([0.5, 0.5, 0.5]),
        np.eye(4)[:4],
        actions=DiscreteActions(4),
        feature_names=["front is wall", "front is lava", "front is goal"],
        groups=[Group("front", (0, 1, 2), ("wall", "lava", "goal"), cell=(0, 2))],
    )
    page = tab.open(written(tree, tmp_path))
    assert page.locator(".inner .view").count() == 3
    assert page.locator(".inner").first.locator(".view .cell").count() == 9
    for category, leaf in (("lava", 5), ("wall", 3), ("goal", 2)):
        page.get_by_role("combobox", name="front").select_option(category)
        x = [float(category == name) for name in ("wall", "lava", "goal")]
        assert lit(page) == np.flatnonzero(tree.decision_path(x)).tolist()
        assert lit(page)[-1] == leaf
    assert near(pixels(page.locator("[data-node='0']")), (242, 142, 28)) > 30  # lava


def test_continuous_and_composed_actions_are_shown(tab, tmp_path):
    rng = np.random.default_rng(4)
    for kind, words in (("box", "gas = "), ("multi_discrete", "gas: ")):
        tree = random_tree(rng, ACTIONS[kind], 2)
        page = tab.open(written(tree, tmp_path))
        leaf = int(np.flatnonzero(tree.is_leaf)[0])
        page.locator(f"[data-node='{leaf}']").hover()
        assert words in page.locator(".node-panel .rule").text_content()
        assert page.locator(".node-panel .filling").count() >= 2
        tab.asked.clear()


def test_a_large_tree_is_folded_at_first_and_fits_when_unfolded(tab, tmp_path):
    tree = random_tree(np.random.default_rng(8), ACTIONS["discrete"], 7)
    page = tab.open(written(tree, tmp_path))
    assert shown(page) == 31
    assert page.locator("[aria-expanded=false]").count() > 3
    page.get_by_role("button", name="Unfold all").click()
    assert shown(page) == tree.n_nodes
    page.get_by_role("button", name="Fit").click()
    window = page.locator(".tree-window").bounding_box()
    drawing = page.locator(".tree-window > g").bounding_box()
    assert drawing["x"] >= window["x"]
    assert drawing["x"] + drawing["width"] <= window["x"] + window["width"] + 1
    assert drawing["y"] + drawing["height"] <= window["y"] + window["height"] + 1
    boxes = page.eval_on_selector_all(
        "[role=treeitem] > .body",
        """all => all.map((one) => one.getBoundingClientRect())
             .map(({ left, right, top, bottom }) => [left, right, top, bottom])""",
    )
    left, right, top, bottom = np.array(boxes).T
    overlap = (
        (left[:, None] < right - 0.01)
        & (left < right[:, None] - 0.01)
        & (top[:, None] < bottom - 0.01)
        & (top < bottom[:, None] - 0.01)
    )
    assert (overlap == np.eye(len(boxes), dtype=bool)).all()


def test_a_very_deep_tree_is_drawn(tab, tmp_path):
    page = tab.open(written(chain(600, to_left=True, actions=DiscreteActions(3)), tmp_path))
    page.get_by_role("button", name="Unfold all").click()
    assert shown(page) == 1201
