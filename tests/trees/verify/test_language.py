"""Rules are read as they are written, names as they are called, numbers as they are; the rest is refused in a line."""

import dataclasses
import json
import re
from decimal import Decimal, localcontext

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group, MultiDiscreteActions
from sympol.trees.boxes import space
from sympol.trees.verify.conditions import Between, Not, boxes_of, interval
from sympol.trees.verify.grammar import Monotone, parse_condition, parse_rule

from ..samples import HOSTILE_NAMES


def leaf(actions, names, groups=(), integers=()) -> DecisionTree:
    return DecisionTree.from_complete(
        np.zeros(0, int),
        np.zeros(0),
        np.zeros((1, actions.n_outputs)),
        actions=actions,
        feature_names=names,
        groups=groups,
        integers=integers,
    )


def same(tree: DecisionTree, *texts: str) -> None:
    """All texts mean the same condition."""
    for bounds in (False, True):
        first, *others = (boxes_of(parse_condition(text, tree), space(tree, bounds=bounds)) for text in texts)
        for other in others:
            assert [a.tolist() for a in (first.low, first.high, first.nan)] == [
                a.tolist() for a in (other.low, other.high, other.nan)
            ]


@pytest.mark.parametrize(
    "texts",
    [
        (
            "pole angle > 0.1",
            "0.1 < pole angle",
            "not pole angle <= 0.1",
            "not pole angle ≤ 0.1",
            "(pole angle>.1)",
        ),
        ("pole angle >= 0.1", "pole angle ≥ 1e-1", "0.1 <= pole angle", "not pole angle < 0.10"),
        (
            "pole angle between -0.1 and 0.1",
            "-0.1 <= pole angle <= 0.1",
            "−0.1 ≤ pole angle and pole angle ≤ 0.1",
        ),
        ("pole angle = 0.5", "pole angle == 0.5", "pole angle is 0.5", "0.5 <= pole angle <= 0.5"),
        (
            "pole angle != 0.5",
            "pole angle ≠ 0.5",
            "pole angle is not 0.5",
            "pole angle < 0.5 or pole angle > 0.5",
        ),
        ('"pole angle" > 1', "pole angle > 1", "pole angle > 1.0", "\tpole angle\n> +1"),
        (
            "cart position > 0 and (cart velocity > 0 or pole angle > 0)",
            "(cart position > 0 and cart velocity > 0) or cart position > 0 and pole angle > 0",
        ),
        ("not (cart position > 0 or pole angle > 0)", "cart position <= 0 and pole angle <= 0"),
    ],
)
def test_ways_to_say_the_same(cartpole, texts):
    same(cartpole, *texts)


@pytest.mark.parametrize(
    "texts",
    [
        ("front is lava", "front is not one of empty, wall, goal", "front is neither empty, wall nor goal"),
        ("front is not lava", "front is one of empty,wall , goal", "not front is lava"),
        (
            "front is neither lava nor wall",
            "front is one of empty, goal",
            "not (front is lava or front is wall)",
        ),
        (
            "front is lava and steps > 3",
            "front is lava > 0.5 and steps > 3",
            "front is lava = 1 and steps > 3",
        ),
        ("front is wall", '"front is wall"', "front is wall >= 1"),
    ],
)
def test_ways_to_say_the_same_of_groups(front, texts):
    # conditions on several categories may be as many boxes in any order
    def sets(text):
        boxes = boxes_of(parse_condition(text, front), space(front, bounds=False))
        observations = np.array([[0, *hot, steps] for hot in np.eye(4) for steps in (0, 9)])
        return boxes.contains(observations).any(axis=0).tolist()

    first = sets(texts[0])
    assert 0 < sum(first) < 8
    assert all(sets(text) == first for text in texts)


@pytest.mark.parametrize(
    ("text", "claim"),
    [
        ("action is push left", Between(0, 0, 0)),
        ("always action is push left", Between(0, 0, 0)),
        ("action is always push left", Between(0, 0, 0)),
        ("action always is 0", Between(0, 0, 0)),
        ("action is not push left", Not(Between(0, 0, 0))),
        ("action is never push left", Not(Between(0, 0, 0))),
        ("action never is push left", Not(Between(0, 0, 0))),
        ("never action is push left", Not(Between(0, 0, 0))),
        ('action is "push right"', Between(0, 1, 1)),
        ("action is increasing in pole angle", Monotone(0, 2, True)),
        ("action is decreasing in pole angle", Monotone(0, 2, False)),
    ],
)
def test_claims(cartpole, text, claim):
    assert parse_rule(text, cartpole).claim == claim
    behind = parse_rule(f"{text} when cart position > 1", cartpole)
    assert behind == parse_rule(f"when cart position > 1 then {text}", cartpole)
    assert behind.claim == claim


def test_actions_are_called_by_name_number_and_component():
    actions = MultiDiscreteActions(
        (2, 3), ("gas", "steer"), (("off", "on"), ("left", "none", "right")), (0, -1)
    )
    tree = leaf(actions, ["x"])
    assert (
        parse_rule("steer is right", tree).claim == Between(1, 1, 1) == parse_rule("steer is 1", tree).claim
    )
    assert parse_rule("steer is -1", tree).claim == Between(1, -1, -1)
    assert parse_rule("gas is on", tree).claim == Between(0, 1, 1)
    box = leaf(BoxActions(-2, 2, (1,), ("torque (N·m)",)), ["cos θ", "angular velocity (rad/s)"])
    low = float(np.nextafter(np.float32(-1.1), np.float32(0)))
    assert parse_rule("torque >= -1.1", box).claim == Between(0, low, np.inf)
    assert parse_rule("torque (N·m) is decreasing in angular velocity", box).claim == Monotone(0, 1, False)


def test_units_may_be_left_out_where_no_other_is_meant():
    tree = leaf(DiscreteActions(2), ["speed (m/s)", "speed (rad/s)", "angle (rad)", "angle", "height (m)"])
    assert parse_condition("height > 1", tree) == parse_condition("height (m) > 1", tree)
    assert parse_condition("angle > 1", tree) == Between(3, *interval(">", 1))  # pyright: ignore
    with pytest.raises(ValueError, match="unknown feature 'speed'; did you mean 'speed "):
        parse_condition("speed > 1", tree)


def test_the_longest_name_that_fits_is_meant_and_words_of_the_language_are_quoted():
    names = ["a", "a and b", "x", "x > 1", "not", "is", "b", "4", "andy"]
    tree = leaf(DiscreteActions(2), names)
    for name in names:
        assert parse_condition(f"{json.dumps(name)} < 0", tree) == parse_condition(
            f"0 > {json.dumps(name)}", tree
        )
        assert parse_condition(f"{json.dumps(name)} < 0", tree).position == names.index(name)  # pyright: ignore
    assert parse_condition("a and b < 0", tree).position == 1  # pyright: ignore
    assert parse_condition("a < 0 and b < 0 and andy < 0", tree).parts[2].position == 8  # pyright: ignore
    with pytest.raises(ValueError, match="expected a feature"):
        parse_condition("is > 1", tree)


@pytest.mark.parametrize("name", [*HOSTILE_NAMES, "*/", "'; DROP TABLE t; --", "__import__('os')", 'a"b\\'])
def test_names_of_strangers_are_names(name):
    group = Group(name + "?", (1, 2), (name, "other"))
    tree = leaf(DiscreteActions(2, (name, "stay")), [name, "f", "g"], [group])
    quoted = json.dumps(name)
    rule = parse_rule(
        f"when {quoted} > 1 and {json.dumps(name + '?')} is {quoted} then action is {quoted}", tree
    )
    assert rule.claim == Between(0, 0, 0)
    assert [part.position for part in rule.condition.parts] == [0, 1]  # pyright: ignore
    with pytest.raises(ValueError, match="expected a number") as refused:
        parse_rule(f"when {quoted} >> 1 then action is 1", tree)
    assert "\n" not in str(refused.value)
    assert str(refused.value).isprintable()


def expected(*parts: str):
    return [pytest.param(*part.split(" → "), id=part.split(" → ")[0][:40]) for part in parts]


@pytest.mark.parametrize(
    ("text", "problem"),
    expected(
        "when pole angel > 0.1 then action is push right → unknown feature 'pole angel'; did you mean 'pole angle'",
        "when pole angle > 0.1 then action is push rigth → unknown action 'push rigth'; did you mean 'push right'",
        "when pole angle > 0.1 then actoin is 1 → unknown action 'actoin'; did you mean 'action'",
        "when pole angle > 0.1 then pole angle > 0 → is a feature",
        "when pole angle > 0.1 action is 1 → expected 'and', 'or' or 'then'",
        "when pole angle then action is 1 → expected a comparison of 'pole angle'",
        "when pole angle > cart position then action is 1 → expected a number",
        "when pole angle > 0.1.2 then action is 1 → expected a number",
        "when pole angle > 1e9999 then action is 1 → expected a number",
        "when pole angle = 0.1 then action is 1 → no float32 number is 0.1",
        "when pole angle between 0 or 1 then action is 1 → expected 'and' and a number",
        "when (pole angle > 0.1 then action is 1 → expected ')'",
        "when 1 + pole angle > 2 then action is 1 → expected '<'",
        "when pole angle > 1 then action is 2 → the number of an action is from 0 to 1, got 2",
        "when pole angle > 1 then action is 0.5 → the number of an action is from 0 to 1, got 0.5",
        "action push left → expected 'is' and an action",
        "action is push left, push right → expected the end of the rule",
        "action is increasing in pole angel → unknown feature 'pole angel'",
        "action is increasing → expected 'in'",
        "action is increasing in pole angle or action is 1 → a claim of its own",
        "never action is increasing in pole angle → a claim of its own",
        "when \"pole angel\" > 1 then action is 1 → unknown name 'pole angel'; did you mean",
        'when "\\x" > 1 then action is 1 → not quoted as in JSON',
        "action is 1 when pole angle > 1 then → expected the end of the rule",
        "when → expected a feature",
        " → expected an action",
    ),
)
def test_what_is_no_rule_is_refused(cartpole, text, problem):
    with pytest.raises(ValueError, match=re.escape(problem)) as refused:
        parse_rule(text, cartpole)
    assert "\n" not in str(refused.value)


def test_what_is_no_rule_about_groups_is_refused(front):
    for text, problem in {
        "when front is lav then action is 1": "unknown category 'lav'; did you mean 'lava'",
        "when front lava then action is 1": "expected 'is' and a category",
        "action is increasing in front is lava": "is of a group",
        "when speed is fast then action is 1": "expected a comparison of 'speed'",
    }.items():
        with pytest.raises(ValueError, match=problem):
            parse_rule(text, front)


def test_names_that_two_have_are_refused(cartpole):
    twice = dataclasses.replace(
        cartpole, feature_names=("x", "x", "y", "z"), actions=DiscreteActions(2, ("go", "go"))
    )
    with pytest.raises(ValueError, match="2 features are called 'x'"):
        parse_rule("when x > 1 then action is 1", twice)
    with pytest.raises(ValueError, match="2 actions are called 'go'"):
        parse_rule("action is go", twice)


@pytest.mark.parametrize(
    "text", ["(" * 4000 + "x > 1", "not " * 2400 + "x > 1", "x" * 20_000, "x[0] > 1" + " or x[0] > 1" * 3000]
)
def test_rules_without_measure_are_refused_at_once(text):
    tree = leaf(DiscreteActions(2), ["x[0]"])
    with pytest.raises(ValueError, match=r"nests too deeply|at most 10,000 characters"):
        parse_condition(text, tree)


def test_a_condition_of_too_many_cases_is_refused():
    tree = leaf(DiscreteActions(2), [f"x{i}" for i in range(20)])
    text = " and ".join(f"(x{i} > 1 or x{i} < 0)" for i in range(20))
    with pytest.raises(ValueError, match="more than 1,000 cases"):
        tree.verify(f"when {text} then action is 1")
    (many,) = tree.verify(f"when not ({text}) then action is 1")
    assert not many.holds
    assert many.counterexample is not None


def test_numbers_are_those_that_are_written():
    rng = np.random.default_rng(0)
    texts = [
        "0",
        "-0",
        "0.1",
        "-0.1",
        "1e-40",
        "-1e-40",
        "1.17549435e-38",
        "16777217",
        "3.4028236e38",
        "1e39",
    ]
    exactly = Decimal(float(np.finfo(np.float32).smallest_normal))
    with localcontext(prec=200):
        texts += [str(sign * (exactly + Decimal(by))) for sign in (-1, 1) for by in ("0", "1e-90", "-1e-90")]
    texts += [str(x) for x in rng.normal(size=50)] + [repr(float(np.float32(x))) for x in rng.normal(size=50)]
    holds = {
        "<": lambda x, r: x < r,
        "<=": lambda x, r: x <= r,
        ">": lambda x, r: x > r,
        ">=": lambda x, r: x >= r,
    }
    tiny = np.finfo(np.float32).smallest_normal
    for text in texts:
        r = Decimal(text)
        with np.errstate(over="ignore", under="ignore"):
            near = np.float32(text)
            grid = [near, np.nextafter(near, np.float32(np.inf)), np.nextafter(near, -np.float32(np.inf))]
        grid += [np.float32(x) for x in (-np.inf, np.inf, 0, tiny, -tiny, 1, -1)]
        for relation, is_true in holds.items():
            low, high = interval(relation, r)
            for x in grid:
                if x == 0 or abs(x) >= tiny:
                    assert (low <= x <= high) == is_true(Decimal(float(x)), r), (text, relation, x)
