"""Whatever things are called, a name never becomes a part of the program."""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from sympol import DecisionTree
from sympol.trees import MultiDiscreteActions
from sympol.trees.export import common
from sympol.trees.export.check import check_observations

from .running import IDS, PROGRAMS, STRANGE, ran, same


@pytest.mark.parametrize(("to", "options"), PROGRAMS, ids=IDS)
def test_it_runs_whatever_things_are_called(strange, to, options):
    for tree in strange:
        x = check_observations(tree, 2000)
        assert same(ran(tree, to, x, **options), tree.predict(x).reshape(len(x), -1), to)


def plainly_named(tree: DecisionTree) -> DecisionTree:
    actions = replace(tree.actions, names=())
    if isinstance(actions, MultiDiscreteActions):
        actions = replace(actions, options=())
    groups = tuple(
        replace(group, name=f"g{i}", categories=tuple(f"c{j}" for j in range(len(group.features))))
        for i, group in enumerate(tree.groups)
    )
    # a feature that is called as SQL's answer is gives that another name
    names = tuple("action" if name == "action" else f"f{i}" for i, name in enumerate(tree.feature_names))
    return replace(tree, actions=actions, groups=groups, feature_names=names)


def without_comments(text: str, to: str) -> str:
    """What a compiler makes of it: comments and strings are nothing."""
    if to.startswith("c"):
        return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    mark = "--" if to == "sql" else "//"
    strings = r'"(?:[^"]|"")*"' if to == "sql" else r'"(?:[^"\\\n]|\\.)*"'
    return re.sub(rf"({strings})|{mark}[^\n]*", "", text)


@pytest.mark.parametrize("to", ["c", "c-header", "rust", "javascript", "sql"])
def test_a_name_of_a_stranger_is_nothing_but_comment_and_string(strange, to):
    for tree in strange:
        text = tree.export(to)
        assert text.isprintable() or set(filter(lambda c: not c.isprintable(), text)) == {"\n"}
        if to != "sql":  # a column may be called in any language
            assert text.isascii()
        plain = plainly_named(tree).export(to)
        assert without_comments(text, to) == without_comments(plain, to)
        # as C99 reads it, which knows trigraphs, and as a page does in which the program stands
        assert "??" not in text or not to.startswith("c")
        if to == "javascript":
            assert not re.search(r"<[/!a-zA-Z]", text)


def test_comments_end_where_they_are_to_end():
    for name in STRANGE:
        words = common.comment(name)
        assert words.isascii()
        assert words.isprintable()
        assert not re.search(r"\*/|/\*|\?\?|\?>|<[/!a-zA-Z]|-->|]]>|\\$", words)
    assert common.comment("speed (km/h) ≤ 3 * 2") == "speed (km/h) <= 3 * 2"


def test_the_program_stands_in_a_page_whatever_things_are_called(strange):
    sync_api = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is not on this machine; install the distribution's package chromium")
    with sync_api.sync_playwright() as playwright:
        options = ["--no-sandbox"] if os.getuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=chromium, args=options)
        page, said = browser.new_page(), []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("dialog", lambda dialog: said.append("a name became a program"))
        for tree in strange:
            x = check_observations(tree, 200)
            x = x[np.isfinite(x).all(axis=1)]
            script = f"{tree.export('javascript')}\nwindow.acted = {x.tolist()}.map(act).flat();"
            page.set_content(f"<script type=module>{script}</script><p>the end</p>")
            page.wait_for_function("window.acted !== undefined")
            assert page.evaluate("window.acted") == tree.predict(x).ravel().tolist()
            assert page.evaluate("document.body.innerText") == "the end"
            page.evaluate("delete window.acted")
        browser.close()
    assert said == []


def test_onnx_is_a_model_by_its_own_checker(strange):
    onnx = pytest.importorskip("onnx")
    for tree in strange:
        model = onnx.load_from_string(tree.export("onnx", name="robot"))
        onnx.checker.check_model(model, full_check=True)
        assert model.graph.name == "robot"
        names = {entry.key: json.loads(entry.value) for entry in model.metadata_props}
        assert names == {"features": list(tree.feature_names), "actions": list(tree.actions.names)}
