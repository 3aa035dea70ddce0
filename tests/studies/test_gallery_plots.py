"""Plots and tables of the gallery of fronts."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from studies.galleries.plots import plot_gallery, smallest
from studies.galleries.published import Target, best_published, published, targets
from studies.galleries.tables import markdown_of_runs

from sympol.search.front.plot import Reference

from ..search.front.synthetic import front, ladder, point
from ..search.front.test_formatting import rows_of


def test_a_mean_that_reaches_its_target_is_bold():
    runs = [ladder(seed, shift=10 * seed) for seed in range(3)]
    sizes = [Target(5, 409), Target(7, 459.1), Target(31, None, "all of it")]
    head, _, small, middle, large = rows_of(markdown_of_runs(runs, sizes))
    assert head == ["at most", "target", "test return", "seed 0", "seed 1", "seed 2"]
    assert small == ["5 nodes", "409", "**409.0 ± 10.0**", "399.0 (5)", "409.0 (5)", "419.0 (5)"]
    assert middle[1:3] == ["459.1", "459.0 ± 10.0"]
    assert large[1:3] == ["all of it", "509.0 ± 10.0"]


def test_without_a_tree_so_small_there_is_no_mean():
    runs = [front([point(5, 400)], seed=0), front([point(1, 9), point(5, 500)], seed=1)]
    _, _, row = rows_of(markdown_of_runs(runs, [Target(3, 500)]))
    assert row[2:] == ["none so small", "none so small", "8.0 (1)"]


def test_a_task_without_targets_has_a_row_for_each_size():
    head, _, *rows = rows_of(markdown_of_runs([ladder(environment="Mine-v0")]))
    assert head == ["at most", "test return", "seed 0"]
    assert [row[0] for row in rows] == ["1 nodes", "5 nodes", "7 nodes", "31 nodes"]


def test_a_gallery_draws_the_smallest_trees_beside_each_front(tmp_path):
    tasks = [[ladder()], [front([point(1, 0.0)], environment="Pendulum-v1")]]
    figure = plot_gallery(tasks, tmp_path / "gallery.svg")
    rows = np.array(figure.axes).reshape(2, 4)
    assert [ax.get_title() for ax in rows[0]] == ["CartPole-v1", "5 nodes: 399.0", "7 nodes: 449.0", ""]
    assert [ax.get_title() for ax in rows[1]] == ["Pendulum-v1", "", "", ""]
    for ax, shown in zip(rows[0, 1:], smallest(tasks[0][0], 3), strict=False):
        answers = [text.get_text() for text in ax.texts]
        assert sum(words.startswith("push") for words in answers) == shown.tree.n_leaves
    assert not rows[0, 3].texts


def test_published_returns_are_the_papers_and_the_targets_grow():
    assert Reference("SYMPOL, paper", -57, 55.0) in published("LunarLander-v3")
    assert Reference("MLP, paper", 241) in published("LunarLander-v3")
    assert published("Mine-v0") == []
    assert targets("Mine-v0") == ()
    for task in ("Acrobot-v1", "LunarLander-v3", "Pendulum-v1"):
        goals = targets(task)
        assert all(a.nodes < b.nodes and a.mean < b.mean for a, b in combinations(goals, 2))


def test_a_gallery_needs_a_task(tmp_path):
    with pytest.raises(ValueError, match="at least one task"):
        plot_gallery([], tmp_path / "gallery.svg")
    assert not list(tmp_path.iterdir())


def test_the_best_published_tree_is_no_larger_than_ours():
    assert best_published("LunarLander-v3", 7) is None
    assert best_published("Pendulum-v1", 100) == Reference("imitation", -261, 63)
