"""The front in words."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from sympol.search.budget import Cost
from sympol.search.front.config import SearchConfig
from sympol.search.front.files import point_folder
from sympol.search.front.formatting import (
    LiveProgress,
    format_cost,
    format_excess,
    markdown,
    next_steps,
    table,
)
from sympol.search.front.messages import save_progress

from .synthetic import front, ladder, point


def lines_of(front_, width=80):
    console = Console(width=width, soft_wrap=True)
    with console.capture() as caught:
        console.print(table(front_))
    return caught.get().splitlines()


def rows_of(text):
    return [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in text.splitlines()
        if line.startswith("|")
    ]


def test_the_table_fits_a_terminal_and_says_all():
    run = front([point(1, -1500.25), point(101, -150.5, method="teacher + prune + evolve", test=np.nan)])
    text = "\n".join(lines_of(run))
    assert max(map(len, text.splitlines())) <= 80
    for words in (
        "−1,500.2 ± 1.0",
        "−1,501.2",
        "−150.5",
        "—",
        "1.23 M + 50 k",
        "51",
        "101",
        "teacher",
    ):
        assert words in text, words
    assert "…" not in text


def test_markup_in_a_method_is_only_words():
    text = "\n".join(lines_of(front([point(1, 1.0, method="[bold]a|b")])))
    assert "[bold]a|b" in text
    assert r"a\|b" in markdown(front([point(1, 1.0, method="[bold]a|b")]))


def test_points_that_differ_look_different():
    rows = rows_of(markdown(front([point(3, 98.980), point(5, 98.985), point(7, 98.988)])))
    shown = [row[3].split()[0] for row in rows[2:]]
    assert shown == ["98.980", "98.985", "98.988"]
    # but not beyond what anybody would tell apart
    rows = rows_of(markdown(front([point(3, 98.98), point(5, 98.980001)])))
    assert {row[3].split()[0] for row in rows[2:]} == {"98.980"}


def test_markdown_has_a_row_for_each_point():
    run = ladder()
    head, rule, *rows = rows_of(markdown(run))
    assert {len(row) for row in (head, rule, *rows)} == {len(head)}
    assert [row[0] for row in rows] == ["1", "5", "7", "31"]
    assert rows[1] == [
        "5",
        "3",
        "2",
        "400.0 ± 1.0",
        "399.0",
        "5.0",
        "teacher",
        "1.23 M + 50 k",
        "640",
        "12",
    ]
    assert markdown(run).endswith(
        "1.23 M steps + 50 k of a teacher, 640 episodes to choose, 12 s; validation on 100 episodes; test on 100; "
        "2026-11-22; commit abcdef0123.\n"
    )


@pytest.mark.parametrize("folder", ["runs/cp", "a folder/$HOME"])
def test_what_to_type_next_names_the_best_point(folder):
    run = ladder()
    steps = next_steps(run, folder)
    for step in steps:
        program, _, path, *_ = shlex.split(step.command)
        assert (program, Path(path)) == ("sympol", point_folder(folder, run.points[-1]))
    assert [shlex.split(step.command)[1] for step in steps] == ["show", "report", "eval", "export"]


def test_costs_in_words():
    assert format_cost(Cost(1_234_567, 0, 0, 61.4)) == "1.23 M steps, 61 s"
    assert format_cost(Cost(950, 2_000_000, 40_000, 0)) == (
        "950 steps + 2 M of a teacher, 40 k episodes to choose, 0 s"
    )


@pytest.mark.parametrize("budget", ["2m", "2M steps", ""])
def test_a_budget_that_was_enough_is_not_mentioned(budget):
    assert format_excess(front([point(1, 1.0)], budget={"budget": budget})) == ""


def test_steps_beyond_a_budget_in_steps_are_named():
    run = front(
        [point(1, 1.0)], budget={"budget": "1M steps"}
    )  # which cost 1,230,000 and 50,000 of a teacher
    assert format_excess(run).startswith("280 k of the steps are beyond the budget of 1M steps: ")


def test_progress_is_the_phase_the_time_and_the_best_of_a_few_sizes(tmp_path):
    for index, best in enumerate([{1: 9.0, 3: 8.0, 5: 300.0}, {5: 250.0, 7: 310.5}]):
        folder = tmp_path / "evolve" / str(index)
        folder.mkdir(parents=True)
        save_progress(folder, best)
    (tmp_path / "evolve" / "1" / "candidates.json").write_text("{}")
    console = Console(width=80)
    progress = LiveProgress(SearchConfig("CartPole-v1", budget="2m"), tmp_path, console)
    with console.capture() as caught:
        progress.watch("evolve", 3.0)
    assert caught.get() == "3 s: evolving trees\n"
    assert progress.line() == "evolving trees · 0:00 of 2:00 · 1 nodes: 9.0 · 5 nodes: 300.0 · 7 nodes: 310.5"
