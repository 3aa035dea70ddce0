"""What cannot be exported or run is refused, and the error says why."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from sympol import DecisionTree
from sympol.trees import BoxActions, DiscreteActions
from sympol.trees.export import FORMATS, c, toolchain
from sympol.trees.export.check import run

from .running import RUNNABLE, ran, trees, with_start


def test_a_program_that_does_not_end_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(toolchain, "TIMEOUT", 0.2)
    with pytest.raises(RuntimeError, match=r"python.* did not end in 0\.2 seconds"):
        toolchain.call([sys.executable, "-c", "while True: pass"], tmp_path)


@pytest.mark.parametrize("to", [to for to in RUNNABLE if to != "treelite"])
def test_actions_too_large_are_refused(to):
    with pytest.raises(ValueError, match=r"2\^53"):
        with_start(2**53).export(to)


def test_treelite_refuses_what_float32_does_not_count():
    with pytest.raises(ValueError, match=r"2\^24"):
        with_start(2**24).export("treelite")


def test_infinite_actions_are_refused():
    tree = DecisionTree.from_complete(
        np.zeros(0, int),
        np.zeros(0),
        np.zeros((1, 1)),
        actions=BoxActions(np.inf, np.inf, (1,)),
        feature_names=["x"],
    )
    with pytest.raises(ValueError, match="must be finite"):
        tree.export("c")


@pytest.mark.parametrize("name", ["", "1st", "my robot", "robot;", "é", "a" * 64, "_x"])
def test_names_that_are_none_are_refused(name):
    for to in ("c", "c-header", "onnx"):
        with pytest.raises(ValueError, match="try 'policy'"):
            trees()["trained"].export(to, name=name)


@pytest.mark.parametrize("to", ["c", "javascript", "sql"])
def test_styles_that_are_none_are_refused(to):
    with pytest.raises(ValueError, match=r"style must be \w+ or \w+, got 'rococo'"):
        trees()["trained"].export(to, style="rococo")


@pytest.mark.parametrize(("to", "module"), [("onnx", "onnx"), ("treelite", "treelite.model_builder")])
def test_without_its_library_the_error_names_the_remedy(to, module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf"pip install 'sympol\[{to}\]'"):
        trees()["trained"].export(to)


def test_every_format_writes_what_it_says():
    tree = trees()["trained"]
    for to, form in FORMATS.items():
        assert isinstance(tree.export(to), bytes if form.binary else str)
        assert form.suffix.startswith(".")


@pytest.mark.parametrize("to", RUNNABLE)
def test_a_tree_without_features_is_not_tried(to):
    tree = DecisionTree.from_complete(np.zeros(0, int), np.zeros(0), np.eye(1, 2), actions=DiscreteActions(2))
    assert tree.export(to)
    with pytest.raises(ValueError, match="without features"):
        run(tree, to, np.zeros((3, 0), np.float32))


def test_a_program_that_fails_says_so(monkeypatch):
    tree, x = trees()["trained"], np.zeros((1, 4), np.float32)
    monkeypatch.setattr(c, "to_c", lambda tree, style: "int policy_act(const float *x) { return y; }\n")
    with pytest.raises(RuntimeError, match=r"cc failed with status 1: (?s:.*)undeclared"):
        ran(tree, "c", x)
    monkeypatch.setattr(toolchain.shutil, "which", lambda name: None)
    for to, package in (("c", "gcc"), ("rust", "rustc"), ("javascript", "nodejs")):
        with pytest.raises(FileNotFoundError, match=f"install the distribution's package {package}$"):
            run(tree, to, x)
