"""The front as a picture."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from studies.galleries.published import published

from sympol.search.front.front import EvaluatedCandidate, FrontError
from sympol.search.front.plot import Reference, looks_of, plot, stairs

from .synthetic import front, ladder, point

BESIDE = [Reference("others", 300, 31), Reference("network", 480)]


def words_of(ax):
    return {text.get_text(): text for text in ax.texts}


def data_of(ax, label):
    return [line.get_xydata() for line in ax.lines if line.get_label() == label]


def test_marks_are_points_and_bars_are_their_intervals():
    run = front([point(1, 300), point(5, 400, method="teacher"), point(31, 500)])
    ax = plot(run).axes[0]
    marks = np.concatenate([*data_of(ax, "scratch"), *data_of(ax, "teacher")])
    assert sorted(map(tuple, marks)) == [(p.nodes, p.mean) for p in run.points]
    bars = {tuple(map(tuple, line.get_xydata())) for line in ax.lines if len(line.get_xydata()) == 2}
    assert {((p.nodes, p.interval[0]), (p.nodes, p.interval[1])) for p in run.points} <= bars
    [tests] = data_of(ax, "test")
    assert [*map(tuple, tests)] == [(p.nodes, p.test.mean) for p in run.points if p.test]


@pytest.mark.parametrize("size", range(1, 32))
def test_the_line_is_what_one_gets_for_at_most_so_many_nodes(size):
    run = ladder()
    x, y = stairs([p.nodes for p in run.points], [p.mean for p in run.points], 40)
    best = run.best(size)
    assert best is not None
    # the last corner at or before a size says the height from there on
    assert y[np.flatnonzero(x <= size)[-1]] == best.mean
    assert (x[-1], y[-1]) == (40, 500)


def test_each_level_of_a_tree_is_one_step_further():
    ax = plot(ladder(), beside=BESIDE).axes[0]
    ticks = ax.get_xticks()
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["1", "3", "7", "15", "31"]
    places = ax.transData.transform([(tick, 450) for tick in ticks])[:, 0]
    np.testing.assert_allclose(np.diff(places), np.diff(places)[0])


def test_roads_are_told_apart_without_colours():
    runs = [front([point(2 * i + 1, i, method=f"method {i}") for i in range(7)])]
    interim_sizes = looks_of(runs)
    assert (
        len({look.marker for look in interim_sizes.values()})
        == len({look.colour for look in interim_sizes.values()})
        == 7
    )
    again = [front([point(2 * i + 1, 7 - abs(i - 7), method=f"method {i}") for i in (6, 0, 3)][1:])]
    assert looks_of([*again, *runs]) == interim_sizes


def test_what_was_tried_lies_faintly_behind():
    tried = [
        EvaluatedCandidate(3, 350.0, "teacher"),
        EvaluatedCandidate(9, 390.0, "scratch"),
        EvaluatedCandidate(11, 410.0, "scratch"),
    ]
    run = front([point(1, 300), point(31, 500)], candidates=tuple(tried))
    ax = plot(run).axes[0]
    faint = [tuple(at) for line in ax.lines if line.get_alpha() for at in line.get_xydata()]
    assert sorted(faint) == sorted((nodes, mean) for nodes, mean, _ in tried)


def test_what_lies_far_below_is_said_in_words():
    rows = [(1, -500.0), (3, -84.0), (11, -83.5), (15, -83.0), (19, -81.0)]
    run = front([point(*row) for row in rows], candidates=(EvaluatedCandidate(5, -499.0, "scratch"),))
    ax = plot(run).axes[0]
    assert ax.get_ylim()[0] > -120
    assert "↓ −500" in words_of(ax)
    assert all(y > -120 for y in np.concatenate(data_of(ax, "scratch"))[:, 1])


@pytest.mark.parametrize("environment", ["CartPole-v1", "Acrobot-v1", "LunarLander-v3", "Pendulum-v1"])
@pytest.mark.parametrize("runs", [1, 3])
def test_labels_cover_neither_each_other_nor_marks(environment, runs):
    shift = {"CartPole-v1": 0.0, "Acrobot-v1": -580.0, "LunarLander-v3": -250.0, "Pendulum-v1": -660.0}
    fronts = [ladder(seed, environment=environment, shift=shift[environment] + seed) for seed in range(runs)]
    figure = plot(fronts, beside=published(environment))
    ax = figure.axes[0]
    FigureCanvasAgg(figure).draw()
    boxes = {words: text.get_window_extent() for words, text in words_of(ax).items()}
    expected = {other.label for other in published(environment)}
    assert all(any(words.startswith(label) for words in boxes) for label in expected)
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        assert not a.overlaps(b), (one, other)
    crosses = [line.get_xydata()[0] for line in ax.lines if line.get_marker() in "+os^D"]
    for words, box in boxes.items():
        assert ax.bbox.padded(1).contains(box.x0, box.y0), words
        assert ax.bbox.padded(1).contains(box.x1, box.y1), words
        for at in ax.transData.transform(crosses):
            assert not box.contains(*at), words


def test_where_there_is_room_a_label_is_right_beside_its_mark():
    others = [Reference("one", 350, 3), Reference("other", 320, 31), Reference("third", 450, 127)]
    figure = plot(front([point(1, 300), point(63, 500)]), beside=others)
    ax = figure.axes[0]
    FigureCanvasAgg(figure).draw()
    for other in others:
        mark = ax.transData.transform((other.nodes, other.mean))
        [box] = [t.get_window_extent() for words, t in words_of(ax).items() if words.startswith(other.label)]
        assert np.linalg.norm(np.clip(mark, box.min, box.max) - mark) < 8 * figure.dpi / 72, other
    assert not [line for line in ax.lines if line.get_gid() == "leader"]


def test_a_label_that_stands_apart_is_led_to_its_mark():
    # so crowded that not all have room beside what they are of
    crowd = [Reference(f"rather long a name {i}", 400 + i, 15) for i in range(8)]
    figure = plot(front([point(1, 300), point(31, 500)]), beside=crowd)
    ax = figure.axes[0]
    FigureCanvasAgg(figure).draw()
    leaders = [
        line.get_transform().transform(line.get_xydata()) for line in ax.lines if line.get_gid() == "leader"
    ]
    assert leaders
    for other in crowd:
        mark = ax.transData.transform((other.nodes, other.mean))
        [box] = [
            t.get_window_extent() for words, t in words_of(ax).items() if words.startswith(f"{other.label} ")
        ]
        near = np.clip(mark, box.min, box.max)
        if np.linalg.norm(near - mark) > 10 * figure.dpi / 72:
            assert any(np.allclose(line, [mark, near], atol=2) for line in leaders), other


@pytest.mark.parametrize("methods", [1, 5, 9])
def test_the_legend_is_inside_the_picture(methods):
    points = [point(2 * i + 1, i, method=f"teacher + prune + evolve {i}") for i in range(methods)]
    figure = plot([front(points, seed=seed) for seed in range(2)])
    FigureCanvasAgg(figure).draw()
    [legend] = figure.legends
    assert len(legend.get_texts()) == methods + 1
    assert figure.bbox.contains(*legend.get_window_extent().min)
    assert figure.bbox.contains(*legend.get_window_extent().max)


def test_of_several_runs_the_mean_of_tests_is_drawn():
    runs = [ladder(seed, shift=10.0 * seed) for seed in range(3)]
    ax = plot(runs).axes[0]
    [mean] = data_of(ax, "test: mean of runs, 95 %")
    assert mean[0].tolist() == [1, 18]
    assert mean[-1, 1] == 509
    assert ax.get_ylabel() == "return"


def test_runs_that_were_not_tested_have_no_mean():
    runs = [front([point(1, 5, test=np.nan)], seed=seed) for seed in range(2)]
    assert not data_of(plot(runs).axes[0], "test: mean of runs, 95 %")


@pytest.mark.parametrize("suffix", [".svg", ".pdf", ".png"])
def test_the_same_front_is_the_same_file(tmp_path, suffix):
    paths = [tmp_path / f"{i}{suffix}" for i in range(2)]
    for path in paths:
        plot([ladder(0), ladder(1, shift=3)], path)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_bad_input_is_refused_before_anything_is_drawn(tmp_path):
    with pytest.raises(ValueError, match="svg"):
        plot(ladder(), tmp_path / "front.gif")
    with pytest.raises(FrontError, match="one task"):
        plot([ladder(0), ladder(1, environment="Acrobot-v1")])
    assert not list(tmp_path.iterdir())
