"""`sympol export`: formats, options, files, and the check that runs what was written."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from sympol.cli import main
from sympol.trees import DecisionTree
from sympol.trees.export import FORMATS, trial

TREE = Path(__file__).parent / "golden" / "trees" / "trained_cartpole.json"


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "policy.json"
    path.write_bytes(TREE.read_bytes())
    return path


@pytest.fixture
def tree() -> DecisionTree:
    return DecisionTree.from_json(TREE.read_text())


def refused(capsys, *words: object, status: int = 2) -> str:
    """The one line that is said."""
    with pytest.raises(SystemExit) as stop:
        main(["export", *map(str, words)])
    assert stop.value.code == status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize("to", list(FORMATS))
def test_every_format_of_a_file(file, tree, tmp_path, to, capsys):
    out = tmp_path / "out"
    assert main(["export", str(file), "--to", to, "--out", str(out)]) == 0
    written = tree.export(to)
    assert out.read_bytes().rstrip() == (written if isinstance(written, bytes) else written.encode()).rstrip()
    assert capsys.readouterr().err == f"written to {out}\n"
    assert main(["export", str(file), "--to", to]) == 0
    if FORMATS[to].binary:  # nothing for a terminal
        assert (tmp_path / f"tree{FORMATS[to].suffix}").read_bytes() == written
        assert capsys.readouterr().out == ""
    else:
        assert capsys.readouterr().out.rstrip() == str(written).rstrip()


def test_options_reach_the_format(file, tree, capsys):
    assert main(["export", str(file), "--to", "c", "--style", "table", "--name", "robot"]) == 0
    assert capsys.readouterr().out == tree.export("c", style="table", name="robot")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "cobol"], "unknown format 'cobol'; there are python, c, "),
        (["--to", "python", "--style", "table"], "python takes no --style; leave it out"),
        (["--to", "rust", "--name", "robot"], "rust takes no --name"),
        (["--to", "c", "--style", "rococo"], "style must be ifs or table, got 'rococo'"),
        (["--to", "c", "--name", "my robot"], "got 'my robot'; try 'policy'"),
        (["--to", "svg", "--check"], "a picture takes no --style, --name or --check, and svg is one"),
        (["--to", "text", "--check"], "what is exported to text cannot be tried here; python, c, rust"),
        (["--to", "sql", "--check"], "add --style sqlite"),
        (["--to", "c", "--out", "/proc/no/such.c"], "choose another --out"),
    ],
)
def test_bad_input_is_one_line(file, words, said, capsys):
    assert said in refused(capsys, file, *words)


def test_a_file_that_is_none(tmp_path, capsys):
    assert "there is no" in refused(capsys, tmp_path / "no.json", "--to", "c")


CHECKED = [
    (["python"], None), (["c"], "cc"), (["c", "--style", "table", "--name", "robot"], "cc"), (["rust"], "rustc"),
    (["javascript"], "node"), (["sql", "--style", "sqlite"], None), (["onnx"], None), (["treelite"], None),
]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "needed"), CHECKED, ids=[words[0][0] + str(len(words[0])) for words in CHECKED]
)
def test_a_check_runs_it(file, words, needed, capsys):
    if needed and shutil.which(needed) is None:
        pytest.skip(f"{needed} is not on this machine")
    assert main(["export", str(file), "--to", *words, "--check"]) == 0
    assert "checked: acts as the tree does on 100,000 observations" in capsys.readouterr().err


def test_a_check_without_its_compiler_names_the_package(file, monkeypatch, capsys):
    monkeypatch.setattr(trial.shutil, "which", lambda name: None)
    for to, package in (("c", "gcc"), ("rust", "rustc"), ("javascript", "nodejs")):
        said = refused(capsys, file, "--to", to, "--check", status=1)
        assert f"install the distribution's package {package}" in said


def test_a_check_that_finds_a_difference_fails(file, tmp_path, monkeypatch, capsys):
    def wrong(tree, to, x, **options):
        return trial.Ran(np.where(x[:, :1] > 1e30, 1 - trial.expected(tree, x), trial.expected(tree, x)))

    monkeypatch.setattr(trial, "run", wrong)
    said = refused(capsys, file, "--to", "c", "--out", tmp_path / "policy.c", "--check", status=1)
    assert "c differs from the tree on " in said
    assert "of 100,000 observations, first on [" in said
    assert not (tmp_path / "policy.c").exists()
