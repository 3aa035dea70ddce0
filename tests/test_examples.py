"""The examples run, with a tiny budget."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from .tiny import quick_compiles

__all__ = ["quick_compiles"]

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_runs(example, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(example), "4096"])
    runpy.run_path(str(example), run_name="__main__")
    said = capsys.readouterr().out
    assert "├─ yes:" in said or said.strip()
    if example.stem == "train_cartpole":
        assert "def act(" in (tmp_path / "cartpole_policy.py").read_text()


def test_an_example_is_short():
    assert len(EXAMPLES) == 3
    assert all(len(file.read_text().splitlines()) < 42 for file in EXAMPLES)
