import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group
from sympol.trees.floats import number, printable
from sympol.trees.text import question

from .samples import ACTIONS, HOSTILE_NAMES, chain, random_tree


@pytest.mark.parametrize("name", ["cartpole", "pendulum", "front"])
@pytest.mark.parametrize("form", ["txt", "json", "py", "rules"])
def test_golden(name, form, request, golden):
    tree: DecisionTree = request.getfixturevalue(name)
    written = {
        "txt": lambda: str(tree) + "\n",
        "json": tree.to_json,
        "py": tree.to_python,
        "rules": lambda: "\n".join(tree.rules()) + "\n",
    }[form]()
    golden(f"trees/{name}.{form}", written)


def test_digits(cartpole):
    assert cartpole.to_text(digits=1).splitlines()[1].startswith("├─ yes: pole angle ≤ 0.02")


def test_thresholds_are_exact_in_the_fewest_digits():
    rng = np.random.default_rng(0)
    bits = rng.integers(2**32, size=20_000, dtype=np.uint32)
    for x in bits.view(np.float32)[np.isfinite(bits.view(np.float32))]:
        assert np.float32(float(number(x))) == x
    assert [number(x) for x in np.float32([0.1, 5, -0.0, 1e-7, 3.4028235e38])] == [
        "0.1",
        "5",
        "-0",
        "1e-07",
        "3.4028235e+38",
    ]


def test_conditions_on_one_feature_become_an_interval():
    tree = DecisionTree.from_complete(
        np.array([0, 0, 0]),
        np.array([0.0, -1.0, 1.0]),
        np.eye(4),
        actions=DiscreteActions(4),
        feature_names=["x"],
    )
    assert [rule.partition(":")[0] for rule in tree.rules()] == [
        "If x ≤ -1",
        "If -1 < x ≤ 0",
        "If 0 < x ≤ 1",
        "If x > 1",
    ]


def one_split(
    threshold: float, name: str = "door", categories: tuple[str, ...] = ("open", "shut")
) -> DecisionTree:
    return DecisionTree.from_complete(
        np.array([1]),
        np.array([threshold]),
        np.eye(2),
        actions=DiscreteActions(2),
        feature_names=[f"x[{i}]" for i in range(len(categories))],
        groups=[Group(name, tuple(range(len(categories))), categories)],
    )


@pytest.mark.parametrize("threshold", [0.0, -0.0, 0.5, np.nextafter(np.float32(1), np.float32(0))])
def test_a_split_between_zero_and_one_asks_for_the_category(threshold):
    tree = one_split(threshold)
    asked = question(tree, 0)
    assert asked.words == "door is shut"
    assert [asked.yes_child, asked.no_child] == tree.apply([[0, 1], [1, 0]]).tolist()
    assert tree.rules() == ["If door is shut: action 1.", "If door is open: action 0."]


@pytest.mark.parametrize("threshold", [-0.1, 1.0, 7.0])
def test_a_split_elsewhere_asks_for_the_number(threshold):
    asked = question(one_split(threshold), 0)
    assert asked.words == f"x[1] ≤ {number(threshold)}"
    assert (asked.yes_child, asked.no_child) == (1, 2)


def test_what_a_group_is_not_becomes_one_phrase():
    def first_rule(n_asked: int, name: str) -> str:
        group = Group(name, (0, 1, 2, 3, 4), ("wall", "lava", "goal", "door", "key"))
        tree = DecisionTree.from_complete(
            np.array([0, 1, 0, 2, 0, 0, 0])[: 2**n_asked - 1],
            np.zeros(7)[: 2**n_asked - 1],
            np.eye(8)[: 2**n_asked],
            actions=DiscreteActions(8),
            feature_names=["x"] * 5,
            groups=[group],
        )
        return next(rule for rule in tree.rules() if "action 0" in rule)

    assert [first_rule(n, "front") for n in (1, 2, 3)] == [
        "If front is not wall: action 0.",
        "If front is neither wall nor lava: action 0.",
        "If front is neither wall, lava nor goal: action 0.",
    ]
    assert [first_rule(n, "") for n in (1, 2, 3)] == [
        "If not wall: action 0.",
        "If neither wall nor lava: action 0.",
        "If neither wall, lava nor goal: action 0.",
    ]


def test_shares_are_never_rounded_to_nothing_or_all():
    tree = DecisionTree.from_complete(np.array([0]), np.array([0.0]), np.eye(2), actions=DiscreteActions(2))
    text = str(tree.with_visits(np.array([[0.0]] * 9999 + [[1.0]])))
    assert ">99 %" in text
    assert "<1 %" in text


def test_hostile_names_stay_on_their_line():
    tree = DecisionTree.from_complete(
        np.arange(7),
        np.zeros(7),
        np.eye(8),
        actions=DiscreteActions(8, tuple(HOSTILE_NAMES)),
        feature_names=HOSTILE_NAMES,
        groups=[Group(HOSTILE_NAMES[1], (0, 2, 3), (HOSTILE_NAMES[0], *HOSTILE_NAMES[2:4]))],
    )
    text = tree.to_text()
    assert len(text.splitlines()) == tree.n_nodes
    assert all(len(rule.splitlines()) == 1 for rule in tree.rules())
    for name in HOSTILE_NAMES[:7]:
        assert printable(name) in text
    assert printable("a\nb") == r"a\nb"


@pytest.mark.parametrize("kind", ACTIONS)
def test_every_tree_has_a_text(kind):
    tree = random_tree(np.random.default_rng(0), ACTIONS[kind])
    assert len(str(tree).splitlines()) == tree.n_nodes
    assert len(tree.rules()) == tree.n_leaves
    assert len(str(chain(300, to_left=True, actions=ACTIONS[kind])).splitlines()) == 601
