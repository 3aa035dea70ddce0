"""How the page looks: in print, in the dark, in narrow windows; and beside another policy."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest

from sympol.algorithms.config import Config
from sympol.envs.registry import resolve
from sympol.report import compare
from sympol.runs.run import Run
from sympol.trees import DecisionTree

from .looking import near, pixels, shown

LIT = (11, 99, 179)  # --lit, in the light


def test_the_picture_looks_right(tab, cartpole_page):
    page = tab.open(cartpole_page)
    picture = pixels(page.locator(".tree-box"))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    blue = near(picture, LIT)
    assert blue > 400  # the way's edges and outlines
    # the leaf reached has its full colour, and the other action's leaves a paler one
    assert near(picture, (86, 180, 233)) + near(picture, (230, 159, 0)) > 1500
    drawing = pixels(page.locator(".picture"))
    assert near(drawing, (216, 138, 31)) > 200  # the pole
    for chart in (".training .chart", ".importance .bar"):
        if page.locator(chart).count():
            assert len(np.unique(pixels(page.locator(chart).first).reshape(-1, 3), axis=0)) > 1


def test_print_shows_everything_and_no_controls(tab, cartpole_page, balance):
    page = tab.open(cartpole_page)
    page.locator("[data-node='1'] .handle").click()
    assert shown(page) == 5
    page.emulate_media(media="print")
    page.wait_for_function("() => document.querySelectorAll('[role=treeitem]').length === 7")
    for control in (".controls", ".tools", ".observation", ".handle", ".tabs"):
        assert not page.locator(control).first.is_visible()
    assert page.locator(".provenance details").get_attribute("open") is not None
    assert page.evaluate("() => getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    page.emulate_media(media="screen")
    page.wait_for_function("() => document.querySelectorAll('[role=treeitem]').length === 5")
    assert page.locator(".provenance details").get_attribute("open") is None


def test_light_and_dark(tab, cartpole_page):
    tab.page.emulate_media(color_scheme="dark")
    page = tab.open(cartpole_page)
    paper = "() => getComputedStyle(document.body).backgroundColor"
    dark = page.evaluate(paper)
    assert pixels(page.locator(".tree-box")).mean() < 80
    page.get_by_role("button", name="Dark colours").click()
    assert page.evaluate(paper) != dark
    assert pixels(page.locator(".tree-box")).mean() > 200
    page.get_by_role("button", name="Dark colours").click()
    assert page.evaluate(paper) == dark


@pytest.mark.parametrize("width", [400, 800, 1600])
def test_nothing_is_wider_than_the_window(tab, cartpole_page, width):
    tab.page.set_viewport_size({"width": width, "height": 900})
    page = tab.open(cartpole_page)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width
    assert page.locator(".tree-window").bounding_box()["width"] > 0.45 * width


def test_everything_has_a_name_and_an_order(tab, cartpole_page):
    page = tab.open(cartpole_page)
    nameless = page.eval_on_selector_all(
        "button, select, input, [role=img], section",
        """all => all.filter((one) => !(one.getAttribute("aria-label") || one.getAttribute("aria-labelledby")
             || one.textContent.trim() || one.labels?.length)).map((one) => one.outerHTML)""",
    )
    assert nameless == []
    ids = page.eval_on_selector_all("[id]", "all => all.map((one) => one.id)")
    assert len(ids) == len(set(ids))
    assert page.evaluate("() => document.documentElement.lang") == "en"


def test_compared_policies_move_in_step(tab, run, tmp_path, balance):
    other = Run.create(tmp_path / "other", resolve("CartPole-v1"), Config(), seed=1)
    other.save_tree(
        DecisionTree.from_complete(
            np.array([2]), np.array([0.0]), np.eye(2), actions=balance.actions,
            feature_names=balance.feature_names, feature_low=balance.feature_low, feature_high=balance.feature_high,
        )
    )  # fmt: skip
    path = tmp_path / "compare.html"
    path.write_text(compare([run, other], episodes=4), encoding="utf-8")
    page = tab.open(path)
    data = json.loads(page.locator("#data").text_content())
    first, second = (policy["episodes"][0] for policy in data["policies"])
    assert first["seed"] == second["seed"]
    assert base64.b64decode(first["observations"])[:16] == base64.b64decode(second["observations"])[:16]
    page.locator(".scrubber").focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    captions = page.locator(".caption strong").all_text_contents()
    assert captions == [one["said"][one["says"][5]] for one in (first, second)]
    page.keyboard.press("End")
    assert page.locator(".caption strong").all_text_contents() == [
        f"{one['end']} after {one['length']} steps" for one in (first, second)
    ]
    cells = page.locator(".numbers tbody tr").nth(1).locator("td").all_text_contents()
    assert cells[3:5] == ["3", "1"]
    assert page.locator(".strip").count() == 8
    assert page.locator(".tree-window").count() == 2
