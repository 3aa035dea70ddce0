"""Soft trees as pictures and as text: what is said of every node, sums that are sums, files that are the same."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.distill.picture import plot_beside, plot_soft_tree
from sympol.distill.picture_boxes import SumBox, boxes_of, chances_of
from sympol.distill.soft_text import leaf_words, node_words, soft_text
from sympol.distill.soft_view import SoftView, in_preorder, percent
from sympol.policies.soft_tree import SoftTree
from sympol.trees.actions import BoxActions, DiscreteActions, MultiDiscreteActions
from sympol.trees.plot_layout import lay_out

ACTIONS: dict[str, Any] = {
    "discrete": DiscreteActions(2, ("push left", "push right")),
    "box": BoxActions((-2.0,), (2.0,), (1,), ("torque",)),
    "two boxes": BoxActions((-2.0, -2.0), (2.0, 2.0), (2,), ("main", "side")),
    "multi": MultiDiscreteActions((2, 3), ("gas", "steer")),
}
NAMES = ("angle", "speed", "a\nb")


def view(depth: int = 3, kind: str = "discrete", features: int = 3, spread: float = 3) -> SoftView:
    actions = ACTIONS[kind]
    actor = SoftTree.create(
        jax.random.key(0), depth=depth, num_features=features, num_outputs=actions.n_outputs
    )
    larger = actor.feature_logits * spread, actor.leaf_values * 20
    actor = eqx.tree_at(lambda tree: (tree.feature_logits, tree.leaf_values), actor, larger)
    names = NAMES if features == 3 else tuple(f"x{i}" for i in range(features))
    return SoftView(actor, np.zeros(features, np.float32), np.ones(features, np.float32), actions, names)


def observations(features: int = 3) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(100, features)).astype(np.float32)


@pytest.mark.parametrize("spread", [0.1, 3])
def test_the_terms_of_a_node_add_up_to_one_and_the_heaviest_is_first(spread):
    soft = view(features=9, spread=spread)
    for node in range(7):
        weights = [term.weight for term in soft.terms(node)]
        assert sum(weights) == pytest.approx(1)
        assert weights[0] == pytest.approx(float(soft.actor.weights[node].max()))
        assert len(weights) <= 5
    everything = soft.terms(0) if spread == 0.1 else []
    assert all(term.name == "5 others" for term in everything[4:])


def test_shares_are_those_of_a_plain_loop_over_the_ways():
    soft = replace(view(), shift=np.float32([1, 0, -1]), scale=np.float32([2, 1, 0.5]))
    x = observations()
    counted = soft.with_shares_of(x)
    weights, expected = np.asarray(soft.actor.weights), np.zeros(8)
    for row in (x - soft.shift) * soft.scale:
        a = np.clip((soft.thresholds - weights @ row) / 2, -1, 1)
        gate = ((a + np.sqrt(2 - a * a)) / 2) ** 2
        for leaf in range(8):
            node, weight = 0, 1.0
            for bit in f"{leaf:03b}":
                weight *= gate[node] if bit == "0" else 1 - gate[node]
                node = 2 * node + 1 + int(bit)
            expected[leaf] += weight / len(x)
    np.testing.assert_allclose(counted.shares, expected, atol=1e-5)
    skeleton = counted.skeleton()
    assert skeleton.n_node_samples is not None
    np.testing.assert_allclose(skeleton.n_node_samples[skeleton.is_leaf] / 1e6, expected, atol=1e-4)


def test_the_skeleton_has_the_nodes_in_preorder():
    soft = view()
    skeleton, order = soft.skeleton(), in_preorder(7)
    for node, original in enumerate(order):
        if original < 7:
            assert skeleton.threshold[node] == soft.thresholds[original]
        else:
            np.testing.assert_array_equal(skeleton.value[node], soft.leaf_values[original - 7])


def test_text_says_every_sum_and_what_every_leaf_would_choose():
    soft = view(depth=2).with_shares_of(observations())
    text = soft_text(soft)
    assert [text.count(node_words(soft, node)) > 0 for node in range(3)] == [True] * 3
    assert [text.count(leaf_words(soft, leaf)) > 0 for leaf in range(4)] == [True] * 4
    assert "from 2 beyond it" in text
    assert "scaled" not in text
    assert not text.endswith("\n")
    assert len(text.split("\n\n")[1].splitlines()) == 7
    assert sum(int(share) for share in re.findall(r"(\d+) %$", text, re.M)) == pytest.approx(100, abs=2)
    scaled = soft_text(replace(soft, scale=np.float32([2, 1, 3]), shift=np.float32([0, 0, -1])))
    assert "The features are scaled. angle: x · 2; a\\nb: (x + 1) · 3." in scaled


def test_a_node_s_words():
    soft = view(depth=1)
    logits = jnp.asarray([[9.0, 0, 0]])
    alone = eqx.tree_at(
        lambda tree: (tree.feature_logits, tree.thresholds), soft.actor, (logits, jnp.array([0.25]))
    )
    assert node_words(replace(soft, actor=alone), 0) == "angle ≤ 0.25"
    both = eqx.tree_at(lambda tree: tree.feature_logits, alone, logits.at[0, 2].set(9.0))
    assert node_words(replace(soft, actor=both), 0) == "0.5·angle + 0.5·a\\nb ≤ 0.25"


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        ("discrete", [0, 1], "push right 73 %, push left 27 %"),
        ("discrete", [9, -9], "push left >99 %"),
        ("box", [3], "torque = 2"),
        ("two boxes", [0.25, -1], "main = 0.25, side = -1"),
        ("multi", [0, 0, 0, 0, 9], "gas: 0 50 %, 1 50 %, steer: 2 >99 %"),
    ],
)
def test_a_leaf_s_words(kind, values, words):
    soft = view(1, kind)
    actor = eqx.tree_at(lambda tree: tree.leaf_values, soft.actor, jnp.asarray([values, values], jnp.float32))
    assert leaf_words(replace(soft, actor=actor), 0) == words


@pytest.mark.parametrize("kind", ACTIONS)
def test_it_is_drawn_and_always_the_same(kind, tmp_path):
    soft = view(2, kind).with_shares_of(observations())
    figure = plot_soft_tree(soft, tmp_path / "a.svg")
    plot_soft_tree(soft, tmp_path / "b.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    said = [text.get_text() for text in (*figure.axes[0].texts, *figure.texts)]
    for node in range(3):
        assert f"Σ ≤ {soft.thresholds[node]:.3g}" in said
    assert {"angle", "speed", "a\\nb"} & set(said)
    assert said.count("yes") == said.count("no") == 3
    assert sum("Ø" in words for words in said) >= 4


def test_probabilities_are_those_of_the_leaf_alone():
    soft = view(1)
    np.testing.assert_allclose(np.sum(chances_of(soft, 0)), 1)
    np.testing.assert_allclose(chances_of(soft, 0)[0], jax.nn.softmax(soft.actor.leaf_values[0]), rtol=1e-5)


@pytest.mark.parametrize("features", [3, 40])
def test_at_depth_five_no_box_lies_on_another_and_bars_have_one_scale(features):
    soft = view(5, features=features, spread=1.5).with_shares_of(observations(features))
    skeleton = soft.skeleton()

    def boxes(downward: bool) -> list[Any]:
        drawn = boxes_of(soft, skeleton, 3, downward=downward)
        return [drawn[node] for node in in_preorder(31)]

    layout, drawn = lay_out(skeleton, boxes)
    assert not layout.downward
    assert len({box.size[0] for box in drawn if isinstance(box, SumBox)}) == 1
    low, high = layout.centre - layout.size / 2, layout.centre + layout.size / 2
    apart = ((low[:, None] >= high[None]) | (high[:, None] <= low[None])).any(axis=-1)
    np.fill_diagonal(apart, True)
    assert apart.all()


def test_beside_a_hard_tree_both_have_one_scale(tmp_path):
    soft = view(2)
    figure = plot_beside(soft, soft.skeleton(), tmp_path / "both.png")
    assert len(figure.axes) == 2
    inches = [ax.get_window_extent().width / figure.dpi for ax in figure.axes]
    units = [ax.get_xlim()[1] for ax in figure.axes]
    assert inches == pytest.approx(units)
    assert (tmp_path / "both.png").stat().st_size > 1000


@pytest.mark.parametrize(
    "draw", [plot_soft_tree, lambda soft, path: plot_beside(soft, soft.skeleton(), path)]
)
def test_bad_input(draw):
    with pytest.raises(ValueError, match=r"saved as \.svg, \.pdf or \.png, got 'tree\.gif'"):
        draw(view(1), "tree.gif")
    with pytest.raises(ValueError, match="depth 8 at most can be drawn, got one of 9"):
        draw(view(9), "tree.svg")
    with pytest.raises(ValueError, match="shares must be one for each of 2 leaves"):
        replace(view(1), shares=np.ones(3))


def test_percent():
    assert [percent(p) for p in (0, 0.001, 0.5, 0.999, 1)] == ["0 %", "<1 %", "50 %", ">99 %", "100 %"]
