from dataclasses import replace

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group, MultiDiscreteActions

from .samples import (
    ACTIONS,
    HOSTILE_NAMES,
    chain,
    consistent,
    every_cell,
    random_grouped_tree,
    random_tree,
    telling_observations,
)

STRANGERS = [
    *HOSTILE_NAMES,
    "*/",
    "</script>",
    "'; DROP TABLE x; --",
    "yes: no:",
    "├─ yes: ",
    "a ≤ 3",
    "b  50 %",
    "+++",
]
HAND = """
pole angle <= 0.021
  no: pole angular velocity <= -0.2
    no: push right
    yes: push left
  yes: push left
"""
HEADER = """+++
features = ["cart position", "cart velocity", "pole angle", "pole angular velocity"]
actions = ["push left", "push right"]
+++
"""


def test_what_was_written_is_read_again():
    for kind in ACTIONS:
        for seed in range(20):
            rng = np.random.default_rng(seed)
            tree = random_tree(rng, ACTIONS[kind])
            again, x = DecisionTree.from_text(tree.to_text(), like=tree), telling_observations(tree, rng, 500)
            np.testing.assert_array_equal(again.predict(x), tree.predict(x))
            for name in ("children_left", "children_right", "feature", "threshold"):
                assert getattr(again, name).tobytes() == getattr(tree, name).tobytes()
            assert again.to_text() == replace(tree, n_node_samples=None).to_text()
            assert again.feature_low.tobytes() == tree.feature_low.tobytes()
            assert again.n_node_samples is None


def test_groups_are_read_as_the_sentences_they_are():
    for kind in ACTIONS:
        for seed in range(20):
            tree = random_grouped_tree(np.random.default_rng(seed), ACTIONS[kind])
            again = DecisionTree.from_text(tree.to_text(), like=tree)
            x = consistent(tree, every_cell(tree, nan=True))
            np.testing.assert_array_equal(again.predict(x), tree.predict(x))
            np.testing.assert_array_equal(again.feature, tree.feature)


@pytest.mark.parametrize(
    "names", [STRANGERS, [" a", "b ", "c  d", "a, b: c", "x = 1, y"]], ids=["hostile", "spaces"]
)
def test_names_of_strangers_are_read_again(names: list[str]):
    n = len(names)
    specs = [
        DiscreteActions(n, tuple(names)),
        MultiDiscreteActions((n, n), (names[0], names[-1]), (tuple(names), tuple(names[::-1]))),
        BoxActions(-1, 1, (n,), tuple(names)),  # pyright: ignore
    ]
    for actions in specs:
        tree = DecisionTree.from_complete(
            np.arange(7) % n,
            np.linspace(-1, 1, 7),
            np.random.default_rng(0).normal(size=(8, actions.n_outputs)),
            actions=actions,
            feature_names=names,
        )
        again = DecisionTree.from_text(tree.to_text(), like=tree)
        np.testing.assert_array_equal(again.feature, tree.feature)
        np.testing.assert_array_equal(
            actions.decide(again.value[tree.is_leaf]), actions.decide(tree.value[tree.is_leaf])
        )


def test_categories_of_strangers_are_read_again():
    n = len(STRANGERS)
    x = np.eye(n, dtype=np.float32)
    for name in (*STRANGERS, "front"):
        tree = DecisionTree.from_complete(
            np.random.default_rng(0).permutation(n)[:7],
            np.full(7, 0.25),
            np.eye(8),
            actions=DiscreteActions(8),
            groups=[Group(name, tuple(range(n)), tuple(STRANGERS))],
            feature_names=[f"f{i}" for i in range(n)],
        )
        again = DecisionTree.from_text(tree.to_text(), like=tree)
        np.testing.assert_array_equal(again.predict(x), tree.predict(x))


def test_what_is_written_by_hand_is_read_from_the_indentation(cartpole):
    tree = DecisionTree.from_text(HAND, like=cartpole)
    assert tree.to_text() == (
        "pole angle ≤ 0.021\n├─ yes: push left\n└─ no:  pole angular velocity ≤ -0.2\n"
        "   ├─ yes: push left\n   └─ no:  push right"
    )
    assert tree == DecisionTree.from_text(tree.to_text(), like=cartpole)
    assert tree == DecisionTree.from_text(HAND.replace("\n", "\r\n").replace("yes", "YES"), like=cartpole)
    assert tree.meta == cartpole.meta
    alone = DecisionTree.from_text(HEADER + HAND)
    assert alone.feature_names == cartpole.feature_names
    assert alone.actions == cartpole.actions
    assert alone.to_text() == tree.to_text()
    given = DecisionTree.from_text(HAND, actions=cartpole.actions, feature_names=cartpole.feature_names)
    assert given == alone


def test_a_listing_with_visits_is_read_without_them(cartpole):
    assert "%" in cartpole.to_text()
    again = DecisionTree.from_text(cartpole.to_text(), like=cartpole)
    assert again.to_text() == replace(cartpole, n_node_samples=None).to_text()


def test_other_signs_are_exact_in_float32():
    edge = np.float32(0.1)
    below, above = np.nextafter(edge, np.float32(-1)), np.nextafter(edge, np.float32(1))
    x = np.array([[below], [edge], [above], [np.nan]], np.float32)
    truths = {
        "<=": x <= edge,
        "≤": x <= edge,
        "<": x < edge,
        ">": ~(x <= edge),
        ">=": ~(x < edge),
        "≥": ~(x < edge),
    }
    for sign, truth in truths.items():
        text = f"x {sign} 0.1\n  yes: a\n  no: b"
        tree = DecisionTree.from_text(text, actions=DiscreteActions(2, ("b", "a")), feature_names=["x"])
        np.testing.assert_array_equal(tree.predict(x), truth[:, 0], err_msg=sign)
    zero = DecisionTree.from_text(
        "x < 0\n yes: a\n no: b", actions=DiscreteActions(2, ("b", "a")), feature_names=["x"]
    )
    np.testing.assert_array_equal(
        zero.predict(np.float32([[-1e-40], [-0.0], [1e-40], [-1.2e-38]])), [0, 0, 0, 1]
    )


def test_not_a_category_is_the_other_way_round(front):
    text = "front is {}lava\n  yes: turn left\n  no: turn right"
    x = np.column_stack([np.zeros(4), np.eye(4), np.zeros(4)])
    np.testing.assert_array_equal(
        DecisionTree.from_text(text.format(""), like=front).predict(x), [1, 1, 0, 1]
    )
    np.testing.assert_array_equal(
        DecisionTree.from_text(text.format("not "), like=front).predict(x), [0, 0, 1, 0]
    )


def test_a_header_says_all_that_the_json_does(front, pendulum):
    text = """+++
features = [
  {name = "speed", low = -1, high = 1},
  {name = "front is wall", low = 0, high = 1},
  {name = "front is lava", low = 0, high = 1},
  {name = "lap", low = 0, high = inf, integer = true},
]
groups = [{name = "front", features = [1, 2], categories = ["wall", "lava"]}]
actions = {type = "box", shape = [1], components = [{name = "torque", low = -2, high = 2, std = 0.5}]}
env = "Mine-v0"
meta = {author = "me"}
+++
front is lava
  yes: torque = -2
  no: lap <= 3
    yes: torque = 0.25
    no: torque = 1e-1
"""
    tree = DecisionTree.from_text(text)
    assert tree.groups == (Group("front", (1, 2), ("wall", "lava")),)
    assert tree.integers == (3,)
    assert tree.feature_high.tolist() == [1, 1, 1, np.inf]
    assert tree.actions == BoxActions(-2, 2, (1,), ("torque",), std=(0.5,))  # pyright: ignore
    assert tree.meta == {"author": "me", "env": "Mine-v0"}
    np.testing.assert_array_equal(
        tree.predict([[0, 0, 1, 0], [0, 1, 0, 3], [0, 1, 0, 4]]), np.float32([[-2], [0.25], [0.1]])
    )


def test_a_single_answer_and_a_long_path_are_trees(cartpole):
    assert DecisionTree.from_text("push right", like=cartpole).predict(np.zeros(4)) == 1
    for to_left in (True, False):
        long = chain(3000, to_left=to_left, actions=DiscreteActions(2))
        again = DecisionTree.from_text(long.to_text(), like=long)
        np.testing.assert_array_equal(again.threshold, long.threshold)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: unknown action ''; there are 'push left', 'push right'"),
        ("push lefft", "line 1: unknown action 'push lefft'; did you mean 'push left'?"),
        ("pole angle <= 0.1", "line 1: unknown action 'pole angle <= 0.1'"),
        ("\n\npole angel <= 0.1\n yes: push left\n no: push left", "line 3: unknown feature 'pole angel'; did"),
        ("pole angle\n yes: push left\n no: push left", "line 1: expected a question such as NAME ≤ NUMBER"),
        ("pole angle <= nan\n yes: push left\n no: push left", "line 1: expected a question"),
        ("pole angle <= 1e40\n yes: push left\n no: push left", "line 1: a threshold must be finite in float32"),
        ("pole angle < -3.4028235e38\n yes: push left\n no: push left", "line 1: a threshold must be finite"),
        ("pole angle <= 0.1\n yes: push left", "line 1: 'pole angle <= 0.1' lacks no: below it"),
        ("pole angle <= 0.1\n yes: push left\n yes: push left", "line 3: a second yes: below line 1"),
        ("pole angle <= 0.1\n no: push left\n  yes: push left", "line 1: 'pole angle <= 0.1' lacks yes: below it"),
        ("pole angle <= 0.1\n  yes: push left\n no: push left", "line 3: .* must be indented alike, got 2 and 1"),
        ("pole angle <= 0.1\n\tyes: push left", "line 2: expected yes: or no:, got a tab"),
        ("pole angle <= 0.1\n maybe: push left", "line 2: expected yes: or no:, got 'maybe: push left'"),
        ("push left\n yes: push left\n no: push left", "line 1: expected a question"),
        ("pole angle <= 0.1\n yes: push\n no: push left", "line 2: unknown action 'push'; did you mean"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_line(cartpole, text: str, message: str):
    with pytest.raises(ValueError, match=message):
        DecisionTree.from_text(text, like=cartpole)
    with pytest.raises(ValueError, match=f"line {int(message[5]) + 4}: "):
        DecisionTree.from_text(HEADER + text, like=cartpole)


def test_answers_of_several_numbers_are_checked(pendulum):
    for text, message in [
        ("torque 1", "'torque 1' is not an action; write it as in 'torque = 0'"),
        ("torque = 3", r"an action must be from \[-2.0\] to \[2.0\]"),
        ("torque = nan", "'torque = nan' is not an action"),
    ]:
        with pytest.raises(ValueError, match=f"line 1: {message}"):
            DecisionTree.from_text(text, like=pendulum)
    twofold = DecisionTree.from_complete(
        np.zeros(0, int), np.zeros(0), np.zeros((1, 4)),
        actions=MultiDiscreteActions((2, 2), ("a", "b"), (("x", "x"), ("y", "z"))), feature_names=["f"],
    )  # fmt: skip
    with pytest.raises(ValueError, match="'a: x, b: y' can be read in 2 ways"):
        DecisionTree.from_text("a: x, b: y", like=twofold)


def test_what_can_be_read_in_two_ways_is_refused():
    actions = DiscreteActions(2)
    answers = "\n yes: action 0\n no: action 1"
    with pytest.raises(ValueError, match="2 of the names are 'a'"):
        DecisionTree.from_text("a <= 1" + answers, actions=actions, feature_names=["a", "a"])
    groups = [Group("", (1, 2), ("a ≤ 1", "b"))]
    with pytest.raises(ValueError, match="can be read in 2 ways"):
        DecisionTree.from_text(
            "a ≤ 1" + answers, actions=actions, feature_names=["a", "b", "c"], groups=groups
        )
    same = DiscreteActions(2, ("go", "go"))
    with pytest.raises(ValueError, match=r"line 1: 2 of the names are 'go', as actions \[0, 1\]"):
        DecisionTree.from_text("go", actions=same, feature_names=["a"])


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("features = [", "the header, between .* is not TOML"),
        ("features = ['a']", "must have both features and actions"),
        (f"features = {'[' * 9999}", "the header nests too deeply"),
        ("feature = ['a']", "the header has an unknown key 'feature'; it may have features"),
        ("features = ['a']\nactions = []", "the header: "),
        ("features = ['a']\nactions = 3", "the header: actions must be of type"),
        ("features = [{name = 'a', low = nan}]\nactions = ['b']", "the header: "),
        ("features = [{nam = 'a'}]\nactions = ['b']", "the header: features.* an object of name, low, high"),
        (
            "features = ['a']\nactions = ['b']\nmeta = {day = 2020-01-01}",
            "the header: .*not JSON serializable",
        ),
        ("features = ['a']\nactions = ['b']\ngroups = [{features = [0]}]", "the header: groups"),
        ("features = ['a']\nactions = ['b']\ngroups = 3", "the header: "),
        ("env = 'CartPole-v1'", "nothing says which features and actions there are: give like="),
    ],
)
def test_a_header_that_says_what_it_cannot_is_refused(header: str, message: str):
    with pytest.raises(ValueError, match=message):
        DecisionTree.from_text(f"+++\n{header}\n+++\nb")


def test_without_any_names_the_remedy_is_told():
    with pytest.raises(ValueError, match="give like=, a tree of the same, or actions= and feature_names="):
        DecisionTree.from_text(HAND)
