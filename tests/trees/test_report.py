"""The page of a policy, read without a browser: whole, self-contained, small, and a stranger's names stay text."""

import base64
import dataclasses
import hashlib
import html.parser
import json
import re

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group, MultiDiscreteActions
from sympol.trees.report import packed, policy_data, write_page
from sympol.trees.report.features import importance
from sympol.trees.text import rules

from .samples import ACTIONS, HOSTILE_NAMES, chain, random_grouped_tree, random_tree

HOSTILE = [
    *HOSTILE_NAMES,
    "</script><script>alert(1)</script>",
    "*/ alert(1) /*",
    "<!-- <script>",
    "`${alert(1)}`",
    "'); DROP TABLE policies; --",
    '"><img src=x onerror=alert(1)>',
    "{{script}}",
    "__proto__",
    "&lt;b&gt;",
]


class Page(html.parser.HTMLParser):
    """The elements of a page, and what is between the tags of each."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in ("meta", "link"):
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if self._open:
            self.texts.setdefault(self._open[-1], []).append(data)

    @property
    def data(self):
        return json.loads(self.texts["script"][0])

    def policy(self):
        metas = [attrs for tag, attrs in self.elements if tag == "meta"]
        return next(m["content"] for m in metas if m.get("http-equiv") == "Content-Security-Policy") or ""


def hostile_tree() -> DecisionTree:
    n = len(HOSTILE)
    rng = np.random.default_rng(1)
    tree = DecisionTree.from_complete(
        rng.integers(n, size=31),
        rng.normal(size=31),
        rng.normal(size=(32, n)),
        actions=DiscreteActions(n, tuple(HOSTILE)),
        feature_names=HOSTILE,
        groups=[Group(HOSTILE[4], (0, 1), (HOSTILE[8], HOSTILE[9]), cell=(1, 1))],
        meta={"env": HOSTILE[8], HOSTILE[8]: HOSTILE[4]},
    )
    x = rng.normal(size=(50, n))
    x[:, :2] = [0, 1]
    return tree.with_visits(x)


def test_a_page_is_whole_and_asks_nothing_of_anyone(cartpole):
    text = cartpole.to_html()
    page = Page(text)
    assert not page._open
    without_namespace = text.replace("http://www.w3.org/2000/svg", "")
    # in the data a program may name an address in a comment; nothing there is ever fetched
    outside = without_namespace.replace(page.texts["script"][0], "")
    assert "http://" not in outside
    assert "https://" not in outside
    assert "@import" not in outside
    assert "url(" not in outside
    addresses = [v for _, attrs in page.elements for k, v in attrs.items() if k in ("src", "href", "action")]
    assert addresses == ["data:,"]
    assert [tag for tag, _ in page.elements].count("script") == 2
    assert len(text) < 120_000


def test_only_the_script_and_the_style_of_the_page_may_run(cartpole):
    page = Page(cartpole.to_html())
    policy = page.policy()
    rules_ = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules_["default-src"] == "'none'"
    assert "unsafe" not in policy

    def named(text):
        return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"

    assert rules_["script-src"] == named(page.texts["script"][1])
    assert rules_["style-src"] == named("".join(page.texts["style"]))


def test_a_strangers_names_are_text_and_nothing_else():
    tree = hostile_tree()
    page = Page(tree.to_html())
    harmless = Page(
        dataclasses.replace(
            tree,
            feature_names=tuple("x" * len(HOSTILE)),
            actions=DiscreteActions(len(HOSTILE)),
            groups=(Group("g", (0, 1), ("a", "b"), cell=(1, 1)),),
            meta={},
        ).to_html()
    )
    # names change the data and the title, and not one element
    assert page.elements[:1] == harmless.elements[:1]
    assert [tag for tag, _ in page.elements] == [tag for tag, _ in harmless.elements]
    assert page.texts["script"][1] == harmless.texts["script"][1]
    block = page.texts["script"][0]
    assert not set("<>&") & set(block)
    assert block.isascii()
    assert page.texts["title"] == [HOSTILE[8]]
    names = [feature["name"] for feature in page.data["policy"]["features"]]
    assert names[8] == HOSTILE[8]
    assert all(name.isprintable() for name in names)


@pytest.mark.parametrize("kind", ACTIONS)
def test_the_data_is_the_tree(kind):
    rng = np.random.default_rng(5)
    for tree in (random_tree(rng, ACTIONS[kind], 5), random_grouped_tree(rng, ACTIONS[kind], 5)):
        data = json.loads(json.dumps(policy_data(tree), allow_nan=False))
        for i, node in enumerate(data["nodes"]):
            assert ("answer" in node) == tree.is_leaf[i]
            if tree.is_leaf[i]:
                assert node["words"] == ", ".join(tree.actions.words(tree.actions.decide(tree.value[[i]])[0]))
                continue
            assert (node["left"], node["right"]) == (tree.children_left[i], tree.children_right[i])
            assert node["feature"] == tree.feature[i]
            assert np.float32(node["threshold"]).tobytes() == tree.threshold[i].tobytes()
        assert [data["nodes"][leaf]["rule"] for leaf in data["order"]] == rules(tree)
        assert tree.n_node_samples is not None
        assert data["visits"] == tree.n_node_samples.tolist()


def test_importance_is_the_share_of_decisions_that_ask():
    rng = np.random.default_rng(6)
    for tree in (
        random_tree(rng, ACTIONS["box"], 6),
        random_grouped_tree(rng, ACTIONS["discrete"], 6, (3, 2), 2),
    ):
        x = rng.normal(size=(300, tree.n_features))
        for group in tree.groups:
            x[:, group.features] = np.eye(len(group.features))[rng.integers(len(group.features), size=300)]
        tree = tree.with_visits(x)
        asked: dict[str, int] = {}
        for path in tree.decision_path(x):
            names = set()
            for node in np.flatnonzero(path & ~tree.is_leaf):
                group = tree.group_of.get(int(tree.feature[node]))
                is_choice = group is not None and 0 <= tree.threshold[node] < 1
                names.add(group.name if is_choice and group else tree.feature_names[tree.feature[node]])
            for name in names:
                asked[name] = asked.get(name, 0) + 1
        shares = importance(tree)
        assert shares is not None
        assert {row["name"]: round(row["share"] * 300) for row in shares if row["share"]} == asked
        assert [row["share"] for row in shares] == sorted((row["share"] for row in shares), reverse=True)


def test_without_visits_nothing_is_said_of_them(pendulum):
    data = policy_data(pendulum)
    assert data["visits"] is None
    assert data["importance"] is None


def test_sliders_reach_what_was_seen_and_every_split_and_stay_in_bounds():
    rng = np.random.default_rng(7)
    for _ in range(20):
        tree = random_tree(rng, ACTIONS["discrete"], 4)
        seen = np.float32(rng.normal(size=(30, 3)))
        for given in (None, seen):
            for i, feature in enumerate(policy_data(tree, given)["features"]):
                low, high = feature["low"], feature["high"]
                assert np.isfinite([low, high]).all()
                assert low >= tree.feature_low[i]
                assert high <= tree.feature_high[i]
                known = tree.threshold[tree.feature == i]
                known = known if given is None else np.concatenate([known, given[:, i]])
                known = np.clip(known, tree.feature_low[i], tree.feature_high[i])
                assert low <= known.min(initial=np.inf)
                assert high >= known.max(initial=-np.inf)


def test_packed_observations_are_the_same_numbers():
    x = np.float32([[0.1, -0.0], [np.inf, np.nan], [1e-40, 3]])
    assert np.frombuffer(base64.b64decode(packed(x)), "<f4").tobytes() == x.tobytes()


def test_small_odd_trees_have_a_page():
    one = DecisionTree.from_complete(
        np.zeros(0, int), np.zeros(0), np.ones((1, 2)), actions=DiscreteActions(2), feature_names=["x"]
    )
    unbounded = DecisionTree.from_complete(
        np.array([0]), np.zeros(1), np.array([[1.0], [2.0]]), actions=BoxActions(-np.inf, np.inf, (1,))
    )
    many = random_tree(np.random.default_rng(2), MultiDiscreteActions((2, 3, 4)))
    for tree in (one, unbounded, many, chain(400, to_left=False, actions=DiscreteActions(3))):
        assert Page(tree.to_html()).data["policy"]["depth"] == tree.depth


def test_what_no_page_can_show_is_refused():
    with pytest.raises(ValueError, match=r"at most 5000 nodes .* got 5001; prune"):
        policy_data(chain(2500, to_left=True, actions=DiscreteActions(2)))
    with pytest.raises(ValueError, match="JSON"):
        write_page("x", "report", {"x": float("nan")})


def test_nothing_in_the_scripts_makes_markup_of_text(cartpole):
    script = Page(cartpole.to_html()).texts["script"][1]
    for risky in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function"):
        assert risky not in script
    assert re.search(r"\bfetch\(|XMLHttpRequest|import\(", script) is None
