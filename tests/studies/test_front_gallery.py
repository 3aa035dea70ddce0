"""Fronts that are kept, and the page made of them."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.galleries.fronts import (
    keep,
    load,
    load_all,
    load_parts,
    main,
    page,
    path_of,
    readme,
    write_docs,
)

from sympol.envs.registry import resolve
from sympol.search.front.files import save_front
from sympol.search.front.front import EvaluatedCandidate, FrontError, best_under_sizes

from ..search.front.synthetic import front, ladder, point

ROOT = Path(__file__).parents[2]


def test_what_is_kept_is_read_again_without_what_was_only_tried(tmp_path):
    runs = [
        replace(ladder(seed, shift=seed / 3), candidates=(EvaluatedCandidate(3, 1.0, "scratch"),))
        for seed in (0, 4)
    ]
    [path] = keep(runs, tmp_path)
    assert path == tmp_path / "studies" / "results" / "fronts" / "CartPole-v1.json"
    assert load(path) == [replace(run, candidates=()) for run in runs]
    before = path.read_bytes()
    keep([], tmp_path)
    keep(load(path), tmp_path)
    assert path.read_bytes() == before


def test_a_run_replaces_that_of_its_seed_and_no_other(tmp_path):
    keep([ladder(0), ladder(1)], tmp_path)
    keep([ladder(1, shift=5), ladder(2), ladder(0, environment="Acrobot-v1")], tmp_path)
    pole = load(path_of("CartPole-v1", tmp_path))
    assert pole == [ladder(0), ladder(1, shift=5), ladder(2)]
    assert [[run.environment for run in runs] for runs in load_all(tmp_path)] == [
        ["CartPole-v1"] * 3,
        ["Acrobot-v1"],
    ]


def test_an_environments_name_is_no_path(tmp_path):
    names = ["sympol/DistShift-Random-v0", "../../outside", "a\\b"]
    written = keep([ladder(environment=name) for name in names], tmp_path)
    assert {path.parent for path in written} == {tmp_path / "studies" / "results" / "fronts"}
    assert sorted(runs[0].environment for runs in load_all(tmp_path)) == sorted(names)


def test_what_was_found_on_a_seed_for_searches_is_not_reported(tmp_path):
    with pytest.raises(ValueError, match="from 0 to 999, got 1000"):
        keep([ladder(1000)], tmp_path)


def test_two_tasks_do_not_share_a_file(tmp_path):
    keep([ladder(0, environment="a/b")], tmp_path)
    with pytest.raises(FrontError, match="one task"):
        keep([ladder(1, environment="a_b")], tmp_path)
    assert load_all(tmp_path) == [[ladder(0, environment="a/b")]]


def test_what_was_not_tested_is_not_kept(tmp_path):
    with pytest.raises(FrontError, match="not tested"):
        keep([front([point(1, 5, test=np.nan)])], tmp_path)
    assert not (tmp_path / "studies" / "results").exists()


@pytest.mark.parametrize(
    "damage",
    [
        lambda c: c.update(version=2),
        lambda c: c.update(runs=[]),
        lambda c: c.update(runs=3),
        lambda c: c["runs"].append(c["runs"][0]),
        lambda c: c["runs"][0].update(seed=1),
        lambda c: c["runs"][0].pop("commit"),
        lambda c: c["points"].clear(),
        lambda c: c["points"][0].pop("run"),
        lambda c: c["points"][0].update(nodes=7),
        lambda c: c["points"][0]["tree"].update(format="other"),
        lambda c: c["points"][0]["test"].update(std=-1),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path, capsys, damage):
    [path] = keep([ladder()], tmp_path)
    content = json.loads(path.read_text())
    damage(content)
    path.write_text(json.dumps(content))
    assert main(["--root", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert re.fullmatch(r"error: .*CartPole-v1\.json.*\n", said.err)


def test_folders_become_a_page_with_all_its_pictures(tmp_path, capsys):
    spec = resolve("CartPole-v1")
    folders = [tmp_path / f"cp{seed}" for seed in range(2)]
    for seed, folder in enumerate(folders):
        save_front(front([point(5, 480 + seed), point(7, 500)], seed=seed), folder, spec)
    assert main([*map(str, folders), "--root", str(tmp_path)]) == 0
    said = [Path(line) for line in capsys.readouterr().out.splitlines()]
    text = (tmp_path / "docs" / "fronts.md").read_text()
    images = re.findall(r"\]\((images/.*?)\)", text)
    assert {tmp_path / "docs" / image for image in images} == {path for path in said if path.suffix == ".svg"}
    assert all(path.stat().st_size for path in said)
    assert "| 5 nodes | 500 | 479.5 ± 0.7 | 479.0 (5) | 480.0 (5) |" in text
    assert "yes: cart position" not in text  # the root of a drawn tree comes first
    assert "```text\ncart position" in text


def test_the_same_results_give_the_same_page_and_old_pictures_go(tmp_path):
    tasks = [[ladder()]]
    first = {path: path.read_bytes() for path in write_docs(tasks, tmp_path)}
    (tmp_path / "images" / "fronts" / "old.svg").write_text("old")
    assert {path: path.read_bytes() for path in write_docs(tasks, tmp_path)} == first
    assert not (tmp_path / "images" / "fronts" / "old.svg").exists()


def with_methods(seed, *methods, shift=0.0):
    return replace(ladder(seed, shift=shift), budget={"budget": "2m", "methods": list(methods)})


def test_searches_by_some_methods_are_kept_apart_and_stand_beside_the_whole_ones(tmp_path):
    whole = [with_methods(seed, "scratch", "teacher", "evolve") for seed in (0, 1)]
    alone = [with_methods(seed, "scratch", shift=-20 - seed) for seed in (0, 1)]
    keep([*whole, *alone, with_methods(0, "scratch", "../../evolve", shift=-5)], tmp_path)
    [tasks] = load_all(tmp_path)
    assert [front.seed for front in tasks] == [0, 1]
    folder = tmp_path / "studies" / "results" / "fronts" / "methods"
    assert len([*folder.iterdir()]) == 2  # no method is a path
    parts = load_parts(tmp_path, "CartPole-v1")
    assert [len(runs) for runs in parts] == [2, 1]
    assert parts[0] == [replace(run, candidates=()) for run in alone]
    text = page([tasks], [parts])
    rows = [line for line in text.splitlines() if line.startswith(("| scratch ", "| scratch + teacher"))]
    best = [best_under_sizes(runs, [5])[0] for runs in (alone, whole)]
    assert [row.split(" | ")[1:3] for row in (rows[0], rows[-1])] == [
        ["2", f"{of.mean:.1f} ± {of.std:.1f}"] for of in best
    ]
    assert "what each method contributes" not in page([tasks])


def test_a_method_cannot_write_on_the_page():
    text = page([[front([point(3, 1.0, method="<script>|*x*")])]])
    assert "<script>" not in text
    assert r"&lt;script&gt;\|\*x\*" in text


def test_the_readme_has_the_picture_and_one_table_of_all_tasks():
    runs = [replace(ladder(), seed=seed) for seed in range(2)]
    text = readme([runs, [ladder(environment="Acrobot-v1", shift=-600)]])
    assert "(docs/images/fronts/gallery.svg)" in text
    rows = [
        [cell.strip() for cell in line[1:-1].split("|")] for line in text.splitlines() if line.startswith("|")
    ]
    assert rows[0] == ["task", "at most", "published", "test return", "nodes", "each run"]
    assert [row[:3] for row in rows[2:]] == [
        ["CartPole-v1", "5", "—"],
        ["Acrobot-v1", "7", "−84 (3)"],
        ["", "31", "−84 (3)"],
    ]
    best = runs[0].best(5)
    assert best is not None
    assert best.test is not None
    assert rows[2][4:] == [str(best.nodes), f"{best.test.mean:.1f} {best.test.mean:.1f}"]


def test_the_page_in_docs_is_what_the_results_say():
    tasks = load_all(ROOT)
    text = (ROOT / "docs" / "fronts.md").read_text(encoding="utf-8")
    parts = [load_parts(ROOT, fronts[0].environment) for fronts in tasks]
    assert text == page(tasks, parts), "write it anew: python -m studies.galleries.fronts"
    images = re.findall(r"\]\((images/.*?)\)", text)
    there = {path for path in (ROOT / "docs" / "images" / "fronts").glob("*")}
    assert {ROOT / "docs" / image for image in images} == there


def test_without_results_the_page_says_so(tmp_path):
    assert main(["--root", str(tmp_path)]) == 0
    assert (tmp_path / "docs" / "fronts.md").read_text() == page([])
    assert "Nothing has been run yet" in page([])
