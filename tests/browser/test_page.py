"""The page decides as the tree does, plays, answers sliders, keys and the pointer, and says what is proven."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest

from sympol.trees import DecisionTree
from sympol.trees.text import rules

from ..trees.samples import (
    ACTIONS,
    consistent,
    plain_leaf,
    random_grouped_tree,
    random_tree,
    telling_observations,
)
from .looking import leaves_in, lit, shown, written


def test_the_page_decides_as_the_tree_does(tab, tmp_path):
    rng = np.random.default_rng(11)
    for tree in (
        random_tree(rng, ACTIONS["discrete"], 7),
        random_tree(rng, ACTIONS["box"], 6),
        random_grouped_tree(rng, ACTIONS["multi_discrete"], 6, (3, 2), 2),
    ):
        page = tab.open(written(tree, tmp_path))
        x = telling_observations(tree, rng, 4000).astype(np.float64)
        if not tree.groups:
            ties = rng.integers(4000, size=(500, 2))
            # between two float32 numbers: what is rounded first is decided otherwise than what is not
            x[ties[:, 0]] *= 1 + rng.uniform(-1e-8, 1e-8, (500, tree.n_features))
        else:
            choice = [np.eye(len(g.features))[rng.integers(len(g.features), size=4000)] for g in tree.groups]
            for group, chosen in zip(tree.groups, choice, strict=True):
                x[:, group.features] = chosen
            assert len(consistent(tree, x)) == len(x)
        assert leaves_in(page, x) == tree.apply(x).tolist()
        assert leaves_in(page, x[:50]) == [plain_leaf(tree, row) for row in x[:50]]
        tab.asked.clear()


def test_the_player_plays_and_the_way_is_lit(tab, cartpole_page, balance):
    page = tab.open(cartpole_page)
    data = json.loads(page.locator("#data").text_content())
    episode = data["player"]["episodes"][0]
    observations = np.frombuffer(base64.b64decode(episode["observations"]), "<f4").reshape(-1, 4)
    assert episode["length"] == len(observations) - 1
    counter, caption = page.locator(".counter"), page.locator(".caption strong")

    def way(step: int) -> list[int]:
        return np.flatnonzero(balance.decision_path(observations[step])).tolist()

    assert counter.text_content() == f"0 / {episode['length']}"
    assert lit(page) == way(0)
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("() => parseInt(document.querySelector('.counter').textContent) > 12")
    page.get_by_role("button", name="Pause").click()
    step = int(counter.text_content().split(" / ")[0])
    assert lit(page) == way(step)
    before = page.locator(".drawing rect").get_attribute("x")
    page.locator(".player").get_by_role("slider").focus()
    page.keyboard.press("End")
    assert counter.text_content() == f"{episode['length']} / {episode['length']}"
    assert caption.text_content() == f"{episode['end']} after {episode['length']} steps"
    page.keyboard.press("ArrowLeft")
    last = episode["length"] - 1
    assert caption.text_content() == episode["said"][episode["says"][last]]
    assert lit(page) == way(last)
    assert page.locator(".drawing rect").get_attribute("x") != before
    assert page.locator(".player [role=status]").text_content().startswith(f"Step {last}: push ")
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    assert counter.text_content() == f"1 / {episode['length']}"
    page.keyboard.press(" ")
    page.wait_for_function("() => parseInt(document.querySelector('.counter').textContent) > 3")


def test_a_slider_changes_the_way(tab, cartpole_page, balance):
    page = tab.open(cartpole_page)
    first = lit(page)
    page.get_by_role("slider", name="pole angular velocity (rad/s)").focus()
    page.keyboard.press("Home")
    page.get_by_role("slider", name="pole angle (rad)").focus()
    page.keyboard.press("Home")
    assert lit(page) == [0, 1, 2]
    assert first != [0, 1, 2]
    assert page.locator(".answer").text_content() == "The tree answers: push left"
    assert page.locator(".edited").is_visible()
    marked = page.locator(".observation .row.asked label").all_text_contents()
    assert marked == ["pole angle (rad)", "pole angular velocity (rad/s)"]
    page.get_by_role("button", name="Back to the episode").click()
    assert lit(page) == first
    assert page.locator(".edited").is_hidden()


@pytest.mark.parametrize(
    ("typed", "number"),
    [("-0.05", -0.05), ("nan", np.nan), ("-inf", -np.inf), ("1e-40", 0.0), ("-0.0500001", -0.0500001)],
)
def test_an_exact_number_may_be_typed(tab, cartpole_page, balance, typed, number):
    page = tab.open(cartpole_page)
    page.get_by_label("pole angle (rad), exact").fill("0")
    field_ = page.get_by_label("pole angular velocity (rad/s), exact")
    for wrong in ("what", "0,5", "", "constructor"):
        field_.fill(wrong)
        field_.press("Enter")
        assert field_.get_attribute("aria-invalid") is not None
    field_.fill(typed)
    field_.press("Enter")
    assert field_.get_attribute("aria-invalid") is None
    assert lit(page) == np.flatnonzero(balance.decision_path([0, 0, 0, number])).tolist()


def test_who_types_is_shown_the_exact_number(tab, cartpole_page):
    page = tab.open(cartpole_page)
    first = json.loads(page.locator("#data").text_content())["player"]["episodes"][0]["observations"]
    x = np.frombuffer(base64.b64decode(first), "<f4")[:4]
    for name, number in zip(("cart position (m)", "pole angle (rad)"), x[[0, 2]], strict=True):
        exact = page.get_by_label(f"{name}, exact")
        exact.focus()
        assert np.float32(exact.input_value()).tobytes() == number.tobytes()
        assert exact.input_value().lstrip("-").lstrip("0.") == str(number).lstrip("-").lstrip("0.")


def test_a_leaf_under_the_pointer_says_its_rule(tab, cartpole_page, balance):
    page = tab.open(cartpole_page)
    data = json.loads(page.locator("#data").text_content())
    counted = [node.get("rule") for node in data["policy"]["nodes"]]
    assert [rule for rule in counted if rule] == [counted[leaf] for leaf in sorted(data["policy"]["order"])]
    panel = page.locator(".node-panel")
    for leaf in np.flatnonzero(balance.is_leaf).tolist():
        page.locator(f"[data-node='{leaf}']").hover()
        assert panel.locator(".rule").text_content() == counted[leaf]
        assert panel.locator(".region li").count() == 2
        shares = panel.locator(".bar-words").all_text_contents()
        assert len(shares) == 2
    plain = [rule.split(":")[0] for rule in rules(balance)]
    assert [counted[leaf].split(":")[0] for leaf in data["policy"]["order"]] == plain
    page.locator("h1").hover()
    assert "reached now" in panel.locator(".eyebrow").text_content()


def test_the_tree_is_walked_by_keys(tab, cartpole_page, balance):
    page = tab.open(cartpole_page)
    focused = "() => document.activeElement.dataset.node"
    page.locator("[role=treeitem]").first.focus()
    assert page.locator("[role=treeitem][tabindex='0']").count() == 1
    for key, node in [
        ("ArrowDown", "1"),
        ("End", "6"),
        ("Home", "0"),
        ("ArrowRight", "1"),
        ("ArrowRight", "2"),
        ("ArrowLeft", "1"),
    ]:
        page.keyboard.press(key)
        assert page.evaluate(focused) == node
    page.keyboard.press("ArrowLeft")
    assert page.locator("[data-node='1']").get_attribute("aria-expanded") == "false"
    assert shown(page) == 5
    assert page.evaluate(focused) == "1"
    page.keyboard.press("ArrowRight")
    assert shown(page) == balance.n_nodes
    assert (
        page.locator("[data-node='1']")
        .get_attribute("aria-label")
        .startswith("Yes: pole angle (rad) ≤ 0.03?")
    )
    assert page.locator("[data-node='3']").get_attribute("aria-level") == "3"
    page.locator("[data-node='4'] .handle").click()
    assert shown(page) == 5
    page.get_by_role("button", name="Unfold all").click()
    assert shown(page) == balance.n_nodes


def test_wheel_drag_and_pinch_move_the_tree(tab, cartpole_page):
    page = tab.open(cartpole_page)
    window = page.locator(".tree-window")

    def place() -> list[float]:
        found = window.locator("> g").get_attribute("transform")
        return [
            float(n) for n in found.replace("translate(", "").replace(") scale(", " ").rstrip(")").split()
        ]

    start = place()
    box = window.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] - 60
    page.mouse.move(*middle)
    page.mouse.wheel(0, 40)
    page.wait_for_timeout(60)
    assert place() == start  # a page that scrolls is not caught
    page.locator("[data-node='0']").click()
    page.mouse.move(*middle)
    page.mouse.wheel(0, -200)
    page.wait_for_timeout(100)
    assert place()[2] > start[2]
    page.get_by_role("button", name="Fit").click()
    before = place()
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] - 60, middle[1] - 30, steps=3)
    page.mouse.up()
    after = place()
    assert after[0] == pytest.approx(before[0] - 60, abs=12)
    assert after[2] == before[2]
    page.evaluate("""() => {
      const window_ = document.querySelector(".tree-window");
      const at = (type, id, x, y) => window_.dispatchEvent(
        new PointerEvent(type, { pointerId: id, clientX: x, clientY: y, bubbles: true }));
      window_.setPointerCapture = () => {};
      at("pointerdown", 1, 300, 300); at("pointerdown", 2, 400, 300);
      at("pointermove", 2, 500, 300); at("pointerup", 1, 300, 300); at("pointerup", 2, 500, 300);
    }""")
    assert place()[2] == pytest.approx(2 * after[2], rel=0.05)


def test_the_copy_button_copies_the_program(tab, cartpole_page, balance):
    tab.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page = tab.open(cartpole_page)
    page.get_by_role("tab", name="json").click()
    assert page.get_by_role("tab", name="json").get_attribute("aria-selected") == "true"
    page.get_by_role("button", name="Copy").click()
    page.get_by_role("button", name="Copied").wait_for()
    copied = DecisionTree.from_json(page.evaluate("() => navigator.clipboard.readText()"))
    assert (copied.threshold == balance.threshold).all()
    page.get_by_role("tab", name="json").press("ArrowRight")
    assert page.locator("[role=tab][aria-selected=true]").count() == 1
    assert page.locator("[role=tab][aria-selected=true]").text_content() != "json"


def test_properties_are_told_and_counterexamples_shown(tab, cartpole_page, balance):
    page = tab.open(cartpole_page)
    checks = page.locator(".checks li")
    assert checks.locator("strong").all_text_contents() == ["left is left", "</script> always right"]
    assert checks.locator(".mark").all_text_contents() == ["✓", "✗"]
    page.get_by_role("button", name="Show in the tree").click()
    assert page.locator(".answer").text_content() == "The tree answers: push left"
    assert lit(page)[-1] in (2, 5)
