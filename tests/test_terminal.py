"""What reaches a terminal: no escape sequences of strangers, and ASCII where it has nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sympol.cli.console import err, out
from sympol.trees import BoxActions, DecisionTree, DiscreteActions, MultiDiscreteActions

from .tiny import quick_compiles, refused, status_of, trained
from .trees.samples import chain

__all__ = ["quick_compiles"]

ESCAPE = "\x1b[31m\x1b]0;title\x07\x9b2J\u202e"
TREE = Path(__file__).parent / "golden" / "trees" / "trained_cartpole.json"


def hostile(actions=None) -> DecisionTree:
    names = (f"push {ESCAPE}", f"pull {ESCAPE}")
    return DecisionTree.from_complete(
        np.array([0]),
        np.array([0.5]),
        np.eye(2),
        actions=DiscreteActions(2, names) if actions is None else actions(names),
        feature_names=[f"x {ESCAPE}"],
        meta={"env": ESCAPE, ESCAPE: ESCAPE},
    )


KINDS = [
    None,
    lambda names: BoxActions(-1, 1, (2,), names),
    lambda names: MultiDiscreteActions((2,), names[:1], (names,)),
]


@pytest.mark.parametrize("actions", KINDS, ids=["discrete", "box", "multi_discrete"])
def test_no_escape_sequence_of_a_tree_reaches_the_terminal(tmp_path, capfd, actions):
    policy, other = tmp_path / "policy.json", tmp_path / "other.json"
    policy.write_text(hostile(actions).to_json())
    changed = hostile(actions)
    other.write_text(DecisionTree.from_json(changed.to_json()).prune().to_json().replace("0.5", "0.25"))
    name = json.dumps(f"x {ESCAPE}")
    for words in (
        ["verify", policy],
        ["verify", policy, "--property", f"when {name} > 0 then action is 0"],
        ["verify", policy, "--property", f"action is never 1 when x {ESCAPE} > 0"],
        ["verify", policy, "--property", ESCAPE],
        ["verify", policy, "--against", other],
        ["verify", policy, "--robustness", "1"],
        ["verify", policy, "--noise", f"{ESCAPE}=x", "--robustness", "1"],
        ["explain", policy, "--observation", "0"],
        ["explain", policy, "--observation", f"{ESCAPE}=1"],
        ["explain", policy, "--episode", "1"],
        ["diff", policy, other],
        ["diff", policy, other, "--episodes", "1"],
        *(
            ["export", policy, "--to", to]
            for to in ("text", "python", "c", "rust", "javascript", "markdown", "json")
        ),
        ["export", policy, "--to", "text", "--out", tmp_path / ESCAPE / "x"],
        ["export", tmp_path / f"{ESCAPE}.json"],
        ["show", tmp_path / ESCAPE],
        [ESCAPE],
    ):
        status_of(*words)
        said = capfd.readouterr()
        for text in (said.out, said.err):
            assert all(c.isprintable() or c == "\n" for c in text), (words, text)
        assert "Traceback" not in said.err


def test_consoles_print_what_they_are_given_as_text(capfd):
    for console in (out, err):
        console.print(f"[bold]{ESCAPE}[/]\nnext", markup=True)
        console.print(ESCAPE, markup=False)
    said = capfd.readouterr()
    assert said.out == said.err
    assert "\\x1b[31m" in said.out
    assert all(c.isprintable() or c == "\n" for c in said.out)


def in_c_locale(*words: object, folder: Path) -> subprocess.CompletedProcess[bytes]:
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("LC_", "LANG"))}
    environment |= {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": ""}
    command = [sys.executable, "-m", "sympol", *map(str, words)]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False)


def test_in_the_c_locale_all_is_ascii_that_can_be_read(tmp_path):
    tree = DecisionTree.from_json(TREE.read_text())
    done = in_c_locale("export", TREE, "--to", "text", folder=tmp_path)
    said = done.stdout.decode("ascii")
    assert said.startswith("pole angular velocity (rad/s) <= -0.14334488\n+- yes: pole angle (rad) <= ")
    assert "\n|  +- yes: push left " in said
    assert "\\u" not in said
    read = DecisionTree.from_text(said, like=tree)
    assert (read.threshold == tree.threshold).all()
    done = in_c_locale("verify", TREE, "--property", "action is 1", folder=tmp_path)
    assert done.stdout.decode("ascii").startswith("FAILS action is 1\n  fails in 5 of 8 leaves")
    done = in_c_locale("verify", TREE, "--properties", "none.toml", "--noise", "θ=x", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.decode("ascii").startswith("error: ")


@pytest.mark.parametrize(
    ("words", "ascii"),
    [
        ("x ≤ 1, y ≥ 2, z ≠ 3", "x <= 1, y >= 2, z != 3"),
        ("├─ yes: a\n│  └─ no:  b", "+- yes: a\n|  +- no:  b"),
        ("cos θ, Δ, ά, Größe, café", "cos theta, Delta, alpha, Grosse, cafe"),
        ("m/s², 5 °, 10⁻⁸, ½", "m/s^2, 5  deg, 10-8, 1/2"),
        ("✓ ✗ ○ → … ± − –", "ok FAILS o -> ... +/- - -"),
        ("水 \ud800", "\\u6c34 \\ud800"),
    ],
)  # fmt: skip
def test_characters_that_a_terminal_lacks_can_be_read(words, ascii):
    import sympol.cli.app  # noqa: F401  # which says how

    assert words.encode("ascii", "sympol.readable").decode() == ascii
    assert "≤ é".encode("latin-1", "sympol.readable") == b"<= \xe9"


@pytest.mark.usefixtures("quick_compiles")
def test_a_run_whose_tree_is_a_chain_is_shown_in_one_line(tmp_path, capsys):
    trained().save(tmp_path / "run")
    policy = tmp_path / "run" / "policy.json"
    document = json.loads(policy.read_text())
    chained = json.loads(chain(40_000, to_left=False, actions=DiscreteActions(2)).to_json())
    policy.write_text(json.dumps({**document, "nodes": chained["nodes"]}))
    assert policy.stat().st_size > 3.6e6
    said = refused(capsys, "show", tmp_path / "run")
    assert said.startswith("error: ")
    assert "more than 100,000,000 characters" in said
    assert refused(capsys, "export", tmp_path / "run", "--to", "text")
    for broken in (
        "[" * 100_000,
        '{"a":' * 5000,
        "[" + "9" * 5000 + "]",
        '{"format": "sympol.tree", "version": [[]]}',
        "\x00",
    ):
        policy.write_text(broken)
        for command in (["show"], ["verify"], ["export", "--to", "c"], ["explain", "--observation", "1"]):
            refused(capsys, command[0], tmp_path / "run", *command[1:])
