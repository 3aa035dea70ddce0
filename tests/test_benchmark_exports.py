"""The benchmark of exports: the page says what was measured, and what is measured acts as the tree does."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from studies.benchmarks import exports

from sympol.trees import DecisionTree

ROOT = Path(__file__).parents[1]


def test_the_page_has_what_was_measured():
    content = json.loads((ROOT / "studies" / "results" / "exports.json").read_text())
    page = (ROOT / "docs" / "guides" / "exports.md").read_text()
    assert f"{exports.MARKS[0]}\n{exports.markdown(content)}\n{exports.MARKS[1]}" in page


def test_what_is_visited_is_cartpole_s(monkeypatch):
    monkeypatch.setattr(exports, "N", 20_000)
    monkeypatch.setattr(exports, "N_ENVS", 50)
    tree = DecisionTree.from_json((ROOT / "tests/golden/trees/trained_cartpole.json").read_text())
    x = exports.visited(tree)
    assert x.shape == (20_000, 4)
    assert x.dtype == np.float32
    assert np.abs(x[:, 2]).max() < 0.21  # a little beyond 12 degrees an episode ends


def test_variants_that_need_no_compiler_act_as_the_tree():
    tree = DecisionTree.from_json((ROOT / "tests/golden/trees/trained_cartpole.json").read_text())
    x = np.random.default_rng(0).normal(size=(3000, 4), scale=0.1).astype(np.float32)
    variants = exports.variants(tree, x, None)
    for name in ("Python file, lists", "SQLite, a query", "onnxruntime, one row", "tree.predict, batch"):
        assert all(seconds > 0 for seconds in variants[name]())


def test_sizes_of_code_are_those_of_the_compilers_there_are():
    tree = DecisionTree.from_json((ROOT / "tests/golden/trees/trained_cartpole.json").read_text())
    for sizes in exports.code_sizes(tree).values():
        assert 50 < sizes["table"] < 1000
        assert 50 < sizes["ifs"] < 1000
