"""The examples run, with a tiny budget."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import jax
import pytest

from sympol.envs.registry import resolve

from .tiny import quick_compiles

__all__ = ["quick_compiles"]

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))


STUDY = "goal_misgeneralization"
"""Has arguments with names; it is tested on Farama's MiniGrid."""

LONGER = {STUDY: 200, "purejax": 130, "ship_a_controller": 100}
"""A study, a whole PPO, and a controller from training to C; all others fit a screen."""


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_runs(example, tmp_path, monkeypatch, capsys):
    arguments = ["4096"]
    if example.stem == "sb3_tree":
        pytest.importorskip("stable_baselines3")
    if example.stem == STUDY:
        pytest.importorskip("minigrid")
        marks = "<!-- written by examples/goal_misgeneralization.py -->", "<!-- until here -->"
        (tmp_path / "page.md").write_text(
            "\n\n".join(("Before.", marks[0], "old words", marks[1], "After.\n"))
        )
        arguments = ["--total-timesteps", "4096", "--docs", "page.md"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(example), *arguments])
    # Optax's schedules mix dtypes, which our own code must not
    with jax.numpy_dtype_promotion("standard" if example.stem == "purejax" else "strict"):
        runpy.run_path(str(example), run_name="__main__")
    said = capsys.readouterr().out
    assert "├─ yes:" in said or said.strip()
    if example.stem == "train_cartpole":
        assert "def act(" in (tmp_path / "cartpole_policy.py").read_text()
    if example.stem == STUDY:
        check_study(tmp_path)


def check_study(folder: Path) -> None:
    """Every picture that is shown is there, and small; the page keeps what is around the results."""
    readme, page = (folder / name for name in ("case-study/README.md", "page.md"))
    for text in (readme, page):
        links = re.findall(r"\]\(([^)\s]+)\)", text.read_text("utf-8"))
        assert len(links) == 12
        assert all((text.parent / link).is_file() for link in links)
    assert sum(file.stat().st_size for file in readme.parent.iterdir()) < 1_500_000
    results = re.sub(r"\(\./", "(case-study/", readme.read_text("utf-8").split("\n", 2)[2])
    assert results.strip() in page.read_text("utf-8")
    assert page.read_text("utf-8").startswith("Before.\n\n<!-- written")
    assert page.read_text("utf-8").endswith("until here -->\n\nAfter.\n")
    assert "old words" not in page.read_text("utf-8")
    for tree in ("first", "second"):
        program = runpy.run_path(str(readme.parent / f"{tree}_tree.py"))
        assert len(program["FEATURES"]) == 45


def test_the_layout_called_home_is_distshift1():
    pytest.importorskip("minigrid")
    study = runpy.run_path(str(next(file for file in EXAMPLES if file.stem == STUDY)))
    from sympol.envs.minigrid.host import rows_of

    fixed, random = (resolve(study[name], backend="host").make_host for name in ("FIXED", "RANDOM"))
    assert fixed is not None
    assert random is not None
    fixed, random = fixed(), random()
    seen = [fixed.reset()[0], random.reset(options=study["LAYOUTS"][study["HOME"]])[0]]
    assert (seen[0] == seen[1]).all()
    assert rows_of(fixed) == rows_of(random)


def test_an_example_is_short():
    assert len(EXAMPLES) >= 5
    for file in EXAMPLES:
        assert len(file.read_text().splitlines()) < LONGER.get(file.stem, 42)


def test_the_tree_is_twenty_lines_of_the_jax_program():
    source = next(file for file in EXAMPLES if file.stem == "purejax").read_text()
    tree = source[source.index("SCALE =") : source.index("def to_tree")]
    assert len([line for line in tree.splitlines() if line]) <= 20
