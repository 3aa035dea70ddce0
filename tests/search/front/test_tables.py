"""The front in words."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from sympol.search.front.files import point_folder
from sympol.search.front.front import Cost
from sympol.search.front.tables import format_cost, markdown, next_steps, table

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
    run = front([point(1, -1500.25), point(101, -150.5, method="teacher + shrink + evolve", test=np.nan)])
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


def test_markup_in_a_road_is_only_words():
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
