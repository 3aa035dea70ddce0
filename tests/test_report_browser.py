"""The pages in a real browser: they load without an error, decide as the tree does, play, fold, zoom and print."""

from __future__ import annotations

import base64
import io
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sympol.algos.config import Config
from sympol.envs.registry import resolve
from sympol.reports import compare, report
from sympol.runs.folder import Run
from sympol.trees import DecisionTree, DiscreteActions
from sympol.trees.text import rules

from .trees.samples import (
    ACTIONS,
    chain,
    consistent,
    plain_leaf,
    random_grouped_tree,
    random_tree,
    telling_observations,
)
from .trees.test_report import HOSTILE, hostile_tree

playwright = pytest.importorskip("playwright.sync_api", reason="needs the package playwright")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs the package chromium")
LIT = (11, 99, 179)  # --lit, in the light


@dataclass
class Tab:
    """A page in the browser, and everything it complained of."""

    page: Any
    complaints: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def open(self, path: Path) -> Any:
        self.page.goto(path.as_uri())
        return self.page


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as engine:
        one = engine.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield one
        one.close()


@pytest.fixture
def tab(browser) -> Iterator[Tab]:
    context = browser.new_context(viewport={"width": 1400, "height": 1000}, color_scheme="light")
    found = Tab(context.new_page())
    found.page.set_default_timeout(10_000)
    found.page.on("console", lambda message: found.complaints.append(message.text))
    found.page.on("pageerror", lambda error: found.complaints.append(str(error)))
    found.page.on("dialog", lambda dialog: (found.complaints.append(dialog.message), dialog.dismiss()))
    found.page.on("request", lambda request: found.asked.append(request.url))
    yield found
    context.close()
    assert found.complaints == []
    assert [url for url in found.asked if not url.startswith(("file:", "data:"))] == []
    assert sum(url.startswith("file:") for url in found.asked) <= 1


@pytest.fixture(scope="module")
def balance() -> DecisionTree:
    """A policy for CartPole that balances."""
    spec = resolve("CartPole-v1")
    return DecisionTree.from_complete(
        np.array([3, 2, 2]),
        np.array([-0.05, 0.03, -0.03]),
        np.array([[2.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 3.0]]),
        actions=spec.actions,
        feature_names=spec.features.names,
        feature_low=spec.features.low,
        feature_high=spec.features.high,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory, balance) -> Run:
    run = Run.create(tmp_path_factory.mktemp("runs") / "balance", resolve("CartPole-v1"), Config(), seed=0)
    run.save_tree(balance)
    (run.path / "safety.toml").write_text(
        '[[property]]\nname = "left is left"\n'
        'rule = "when pole angle (rad) < -0.1 and pole angular velocity (rad/s) < -1 then action is push left"\n'
        '[[property]]\nname = "</script> always right"\nrule = "action is always push right"\n'
    )
    return run


@pytest.fixture(scope="module")
def cartpole_page(run, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("pages") / "report.html"
    path.write_text(report(run, episodes=5), encoding="utf-8")
    return path


def written(tree: DecisionTree, folder: Path) -> Path:
    path = folder / "tree.html"
    path.write_text(tree.to_html(), encoding="utf-8")
    return path


def lit(page: Any) -> list[int]:
    return page.eval_on_selector_all(
        "[role=treeitem].lit", "items => items.map((item) => Number(item.dataset.node))"
    )


def shown(page: Any) -> int:
    return page.locator("[role=treeitem]").count()


def pixels(locator: Any) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(locator.screenshot())).convert("RGB")).astype(int)


def near(picture: np.ndarray, colour: tuple[int, ...]) -> int:
    """How many pixels have a colour."""
    return int((np.abs(picture - np.array(colour)).max(axis=2) <= 6).sum())


def leaves_in(page: Any, x: np.ndarray) -> list[int]:
    """The leaves of float64 observations, asked of the page's own program."""
    text = base64.b64encode(x.astype("<f8").tobytes()).decode()
    return page.evaluate(
        """([text, columns]) => {
          const numbers = new Float64Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
          const leaves = [];
          for (let i = 0; i < numbers.length; i += columns)
            leaves.push(sympol.leafOf(numbers.subarray(i, i + columns)));
          return leaves;
        }""",
        [text, x.shape[1]],
    )


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


def test_a_strangers_names_stay_text(tab, tmp_path):
    tree = hostile_tree()
    page = tab.open(written(tree, tmp_path))
    assert page.locator("h1").text_content() == HOSTILE[8]
    assert page.title() == HOSTILE[8]
    assert page.locator("script").count() == 2
    assert page.locator("img, iframe, b").count() == 0
    labels = page.locator(".observation label[for]").all_text_contents()
    expected = {"*/ alert(1) /*", "`${alert(1)}`", "{{script}}", "__proto__", "&lt;b&gt;"}
    assert expected <= set(labels)
    everything = page.locator("body").text_content()
    assert "</svg><script>alert(1)</script>--> ]]>" in everything
    page.get_by_role("button", name="Unfold all").click()
    assert shown(page) == tree.n_nodes


def test_a_category_is_chosen_in_a_list_and_drawn_in_a_view(tab, tmp_path):
    from sympol.trees import Group

    tree = DecisionTree.from_complete(
        np.array([1, 0, 0]),
        np.float32([0.5, 0.5, 0.5]),
        np.eye(4)[:4],
        actions=DiscreteActions(4),
        feature_names=["front is wall", "front is lava", "front is goal"],
        groups=[Group("front", (0, 1, 2), ("wall", "lava", "goal"), cell=(0, 2))],
    )
    page = tab.open(written(tree, tmp_path))
    assert page.locator(".inner .view").count() == 3
    assert page.locator(".inner").first.locator(".view .cell").count() == 9
    for category, leaf in (("lava", 5), ("wall", 3), ("goal", 2)):
        page.get_by_role("combobox", name="front").select_option(category)
        x = [float(category == name) for name in ("wall", "lava", "goal")]
        assert lit(page) == np.flatnonzero(tree.decision_path(x)).tolist()
        assert lit(page)[-1] == leaf
    assert near(pixels(page.locator("[data-node='0']")), (242, 142, 28)) > 30  # lava


def test_continuous_and_composed_actions_are_shown(tab, tmp_path):
    rng = np.random.default_rng(4)
    for kind, words in (("box", "gas = "), ("multi_discrete", "gas: ")):
        tree = random_tree(rng, ACTIONS[kind], 2)
        page = tab.open(written(tree, tmp_path))
        leaf = int(np.flatnonzero(tree.is_leaf)[0])
        page.locator(f"[data-node='{leaf}']").hover()
        assert words in page.locator(".node-panel .rule").text_content()
        assert page.locator(".node-panel .filling").count() >= 2
        tab.asked.clear()


def test_a_large_tree_is_folded_at_first_and_fits_when_unfolded(tab, tmp_path):
    tree = random_tree(np.random.default_rng(8), ACTIONS["discrete"], 7)
    page = tab.open(written(tree, tmp_path))
    assert shown(page) == 31
    assert page.locator("[aria-expanded=false]").count() > 3
    page.get_by_role("button", name="Unfold all").click()
    assert shown(page) == tree.n_nodes
    page.get_by_role("button", name="Fit").click()
    window = page.locator(".tree-window").bounding_box()
    drawing = page.locator(".tree-window > g").bounding_box()
    assert drawing["x"] >= window["x"]
    assert drawing["x"] + drawing["width"] <= window["x"] + window["width"] + 1
    assert drawing["y"] + drawing["height"] <= window["y"] + window["height"] + 1
    boxes = page.eval_on_selector_all(
        "[role=treeitem] > .body",
        """all => all.map((one) => one.getBoundingClientRect())
             .map(({ left, right, top, bottom }) => [left, right, top, bottom])""",
    )
    left, right, top, bottom = np.array(boxes).T
    overlap = (
        (left[:, None] < right - 0.01)
        & (left < right[:, None] - 0.01)
        & (top[:, None] < bottom - 0.01)
        & (top < bottom[:, None] - 0.01)
    )
    assert (overlap == np.eye(len(boxes), dtype=bool)).all()


def test_a_very_deep_tree_is_drawn(tab, tmp_path):
    page = tab.open(written(chain(600, to_left=True, actions=DiscreteActions(3)), tmp_path))
    page.get_by_role("button", name="Unfold all").click()
    assert shown(page) == 1201


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
