"""`sympol export`: formats, options, files, and the check that runs what was written."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from sympol.cli.app import main
from sympol.trees import DecisionTree
from sympol.trees.export import FORMATS, check, toolchain

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
        (["--to", "text", "--check"], "what is exported to text cannot be run here; python, c, rust"),
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
    monkeypatch.setattr(toolchain.shutil, "which", lambda name: None)
    for to, package in (("c", "gcc"), ("rust", "rustc"), ("javascript", "nodejs")):
        said = refused(capsys, file, "--to", to, "--check", status=1)
        assert f"install the distribution's package {package}" in said


def test_a_check_that_finds_a_difference_fails(file, tmp_path, monkeypatch, capsys):
    def wrong(tree, to, x, **options):
        expected = check.expected_actions(tree, x)
        return toolchain.Run(np.where(x[:, :1] > 1e30, 1 - expected, expected), ())

    monkeypatch.setattr(check, "run", wrong)
    said = refused(capsys, file, "--to", "c", "--out", tmp_path / "policy.c", "--check", status=1)
    assert "c differs from the tree on " in said
    assert "of 100,000 observations, first on [" in said
    assert not (tmp_path / "policy.c").exists()


def written(capsys, *words: object) -> list[Path]:
    """The files that an export says it has written."""
    assert main(["export", *map(str, words)]) == 0
    said = capsys.readouterr().err.splitlines()
    return [Path(line.removeprefix("written to ")) for line in said]


@pytest.mark.parametrize("to", ["svg", "png", "pdf"])
def test_a_dot_in_a_name_is_no_suffix(file, tmp_path, to, capsys):
    for value in ("0.1", "0.2", "1e-3.5"):
        path = tmp_path / f"lr{value}"
        assert written(capsys, file, "--to", to, "--out", path) == [tmp_path / f"lr{value}.{to}"]
        assert written(capsys, file, "--to", "c", "-o", path) == [path]  # texts exactly there, as ever
    assert len(list(tmp_path.glob(f"lr*.{to}"))) == 3


@pytest.mark.parametrize("name", ["a.py", "a.c", "a.h", "a.hpp", "a.rs", "a.js", "a.mjs", "a.sql", "a.onnx", "a.json",
                                  "a.txt", "a.md", "a.mmd", "a.dot", "a.tex", "lr0.1.md", "A.MD"])  # fmt: skip
def test_the_suffix_says_what_is_written(file, tree, tmp_path, name, capsys):
    path = tmp_path / name
    assert written(capsys, file, "-o", path) == [path]
    suffix = {".hpp": ".h", ".mjs": ".js"}.get(path.suffix.lower(), path.suffix.lower())
    (to,) = [to for to, form in FORMATS.items() if form.suffix == suffix]
    expected = tree.export(to)
    assert (
        path.read_bytes().rstrip()
        == (expected if isinstance(expected, bytes) else expected.encode()).rstrip()
    )


@pytest.mark.parametrize("name", ["a.svg", "a.pdf", "a.PNG"])
def test_pictures_go_by_their_suffix_too(file, tmp_path, name, capsys):
    assert written(capsys, file, "--out", tmp_path / name) == [tmp_path / name]
    assert (tmp_path / name).read_bytes()[:4] in (b"<?xm", b"%PDF", b"\x89PNG")


@pytest.mark.parametrize(("alias", "to"), [("js", "javascript"), ("py", "python"), ("md", "markdown"), ("rs", "rust"),
                                           ("h", "c-header"), ("txt", "text"), ("tex", "latex")])  # fmt: skip
def test_formats_have_the_names_of_their_suffixes(file, tree, alias, to, capsys):
    assert main(["export", str(file), "--to", alias]) == 0
    assert capsys.readouterr().out.rstrip() == tree.export(to).rstrip() == tree.export(alias).rstrip()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "svg", "--out", "x.jpg"], "--to svg writes a file that ends in .svg, but --out is x.jpg"),
        (["--to", "svg", "--out", "x.png"], "--to svg writes a file that ends in .svg, but --out is x.png"),
        (["--to", "python", "--out", "x.c"], "--to python writes a file that ends in .py, but --out is x.c"),
        (
            ["--to", "python", "--out", "x.jpg"],
            "--to python writes a file that ends in .py, but --out is x.jpg",
        ),
        (["--to", "c", "--out", "x.h"], "--to c writes a file that ends in .c, but"),
        (["--to", "h", "--out", "x.c"], "--to h writes a file that ends in .h or .hpp or .hh, but"),
        (["--to", "json", "--out", "x.svg"], "--to json writes a file that ends in .json, but"),
        (
            ["--out", "x.jpg"],
            "nothing that is exported has the suffix .jpg, as in x.jpg; say what it is: --to",
        ),
        (["-o", "x.gif"], "say what it is: --to"),
        (["-o", "x.svg", "--check"], "and svg is one"),
        (["-o", "x.rs", "--style", "table"], "rust takes no --style"),
    ],
)
def test_a_suffix_of_something_else_is_refused(file, tmp_path, monkeypatch, words, said, capsys):
    monkeypatch.chdir(tmp_path)
    assert said in refused(capsys, file, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["policy.json"]
