import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group

from .samples import ACTIONS, HOSTILE_NAMES, random_grouped_tree, random_tree


@pytest.mark.parametrize("kind", ACTIONS)
def test_round_trip_is_exact(kind):
    rng = np.random.default_rng(0)
    for _ in range(10):
        tree = random_tree(rng, ACTIONS[kind])
        assert DecisionTree.from_json(tree.to_json()) == tree
        assert DecisionTree.from_json(tree.prune().to_json()) == tree.prune()


def test_groups_come_back(front):
    assert DecisionTree.from_json(front.to_json()) == front
    assert DecisionTree.from_json(front.to_json()).groups == front.groups
    assert '"groups"' not in dataclasses.replace(front, groups=()).to_json()
    group = Group(HOSTILE_NAMES[0], (1, 3), (HOSTILE_NAMES[1], HOSTILE_NAMES[1]))
    other = dataclasses.replace(front, groups=[Group("", (2,), ("",), (0, 999)), group])
    assert DecisionTree.from_json(other.to_json()) == other != front


def test_every_float32_comes_back():
    bits = np.random.default_rng(1).integers(2**32, size=4095, dtype=np.uint32).view(np.float32)
    threshold = np.where(np.isfinite(bits), bits, np.float32(-0.0))
    threshold[:3] = np.finfo(np.float32).max, np.finfo(np.float32).smallest_normal, -0.0
    tree = DecisionTree.from_complete(
        np.zeros(4095, int),
        threshold,
        np.zeros((4096, 1)),
        actions=DiscreteActions(1),
        feature_high=[3.4028235e38],
    )
    again = DecisionTree.from_json(tree.to_json())
    assert again == tree
    assert again.threshold.tobytes() == tree.threshold.tobytes()


def test_std_and_meta_come_back(pendulum, cartpole):
    assert DecisionTree.from_json(pendulum.to_json()).actions == pendulum.actions
    assert DecisionTree.from_json(cartpole.to_json()).meta == {"env": "CartPole-v1"}


def test_hostile_names_come_back():
    tree = DecisionTree.from_complete(
        np.array([0]),
        np.array([0.0]),
        np.eye(2, 8),
        actions=DiscreteActions(8, tuple(HOSTILE_NAMES)),
        feature_names=HOSTILE_NAMES,
    )
    text = tree.to_json()
    assert text.isascii()
    assert DecisionTree.from_json(text) == tree


def edited(tree: DecisionTree, *path, to) -> str:
    """Change one thing in the document."""
    document = json.loads(tree.to_json())
    place = document
    for step in path[:-1]:
        place = place[step]
    if to is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = to
    return json.dumps(document)


@pytest.mark.parametrize(
    ("path", "to", "message"),
    [
        (["format"], "other", "not a tree of sympol"),
        (["version"], 2, "version 2 .* reads version 1"),
        (["extra"], 1, "the document must be an object of"),
        (["meta"], ..., "the document must be an object of"),
        (["meta"], 3, "meta must be an object"),
        (["features"], {}, "features must be a list"),
        (["features", 0, "name"], 3, "a feature's name must be a string"),
        (["features", 0, "low"], "-infinity", "low must be a finite float32 number"),
        (["features", 0, "low"], 9, "feature_low must not exceed"),
        (["features", 0], ..., r"feature must be in \[0, 3\)"),
        (["actions", "type"], "none", "actions must be of type"),
        (["actions", "names"], ["only one"], r"nodes\[6\].value must be 1 numbers"),
        (["actions", "names"], [], "at least one action"),
        (["actions", "start"], True, "start must be an integer"),
        (["actions", "start"], 2**60, "start must be an integer"),
        (["nodes"], [], "one leaf more"),
        (["nodes"], [1], "one leaf more"),
        (["nodes", 0, "left"], 2, "preorder"),
        (["nodes", 1, "left"], 1, r"nodes\[1\].left must be an integer from 2 to 6"),
        (["nodes", 0, "right"], 7, "right must be an integer from 1 to 6"),
        (["nodes", 0, "right"], 2.0, "right must be an integer"),
        (["nodes", 0, "feature"], -2, "feature must be an integer from 0"),
        (["nodes", 0, "feature"], 99, "feature must be in"),
        (["nodes", 0, "threshold"], None, "threshold must be a finite float32 number"),
        (["nodes", 0, "threshold"], 1e39, "threshold must be a finite float32 number"),
        (["nodes", 0, "threshold"], 10**400, "threshold must be a finite float32 number"),
        (["nodes", 0, "threshold"], False, "threshold must be a finite float32 number"),
        (["nodes", 2, "value"], [1.0], "value must be 2 numbers"),
        (["nodes", 2, "value"], "12", "value must be a list"),
        (["nodes", 2, "visits"], ..., r"nodes\[2\] must be an object of value, visits"),
        (["nodes", 2, "visits"], -1, "visits must be an integer from 0"),
        (["nodes", 2, "visits"], 2**53, "visits below"),
    ],
)
def test_edited_files_are_refused(cartpole, path, to, message):
    with pytest.raises(ValueError, match=message):
        DecisionTree.from_json(edited(cartpole, *path, to=to))


@pytest.mark.parametrize(
    ("path", "to", "message"),
    [
        ([], {}, "groups must be a list"),
        ([], None, "groups must be a list"),
        ([], [], "groups must be left out where there are none"),
        ([], [3], r"groups\[0\] must be an object of name, features, categories, cell"),
        ([0, "cell"], ..., r"groups\[0\] must be an object of"),
        ([0, "extra"], 1, r"groups\[0\] must be an object of"),
        ([0, "name"], None, r"groups\[0\].name must be a string"),
        ([0, "features"], "1234", r"groups\[0\].features must be a list"),
        ([0, "features"], [], "different positions"),
        ([0, "features"], [1, 1, 2, 3], "different positions"),
        ([0, "features"], [1, 2, 3], "a category, a string, for each of its 3 features"),
        ([0, "features", 0], 6, "features must be an integer from 0 to 5"),
        ([0, "features", 0], -1, "features must be an integer from 0 to 5"),
        ([0, "features", 0], True, "features must be an integer"),
        ([0, "features", 0], 1.0, "features must be an integer"),
        ([0, "categories"], "abcd", r"groups\[0\].categories must be a list"),
        ([0, "categories", 0], None, r"groups\[0\].categories must be a string"),
        ([0, "cell"], 3, r"groups\[0\].cell must be a list"),
        ([0, "cell"], [], r"groups\[0\].cell must be \[row, column\] or null"),
        ([0, "cell"], [1, 2, 3], r"groups\[0\].cell must be \[row, column\] or null"),
        ([0, "cell"], [1, None], r"groups\[0\].cell must be an integer from 0 to 999"),
        ([0, "cell"], [1, 1000], r"groups\[0\].cell must be an integer from 0 to 999"),
        ([0, "cell"], [-1, 0], r"groups\[0\].cell must be an integer from 0 to 999"),
        ([], [{"name": "", "features": [1], "categories": [""], "cell": None}] * 2, "in two groups"),
    ],
)
def test_edited_groups_are_refused(front, path, to, message):
    with pytest.raises(ValueError, match=message):
        DecisionTree.from_json(edited(front, "groups", *path, to=to))


@pytest.mark.parametrize("shape", [[2], [0], [], [1] * 40, [-1], [1.0]])
def test_edited_box_actions_are_refused(pendulum, shape):
    text = edited(pendulum, "actions", "shape", to=shape)
    if shape == []:
        assert DecisionTree.from_json(text).predict(np.zeros(3)).shape == ()
    else:
        with pytest.raises(ValueError, match="shape"):
            DecisionTree.from_json(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not JSON"),
        ("[]", "not a tree"),
        ('{"format": "sympol.tree", "version": 1, "x": NaN}', "no NaN"),
        ("[" * 100_000, "nests too deeply"),
        ('{"format": "sympol.tree"', "cut off"),
    ],
)
def test_other_texts_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        DecisionTree.from_json(text)


def test_a_cut_file_is_refused(cartpole):
    text = cartpole.to_json().rstrip()
    for length in range(0, len(text), 7):
        with pytest.raises(ValueError, match="not JSON"):
            DecisionTree.from_json(text[:length])


def test_a_small_file_takes_little_memory():
    # 40,000 outputs times 40,000 nodes would be 6 GB, but the file has no leaf
    code = """if True:
        import json, resource
        from sympol.trees import DecisionTree
        resource.setrlimit(resource.RLIMIT_AS, (2 * 2**30,) * 2)
        node = {"feature": 0, "threshold": 0, "left": 1, "right": 2}
        names = [""] * 40_000
        document = {"format": "sympol.tree", "version": 1, "features": [], "nodes": [node] * 40_000, "meta": {},
                    "actions": {"type": "discrete", "start": 0, "names": names}}
        try:
            DecisionTree.from_json(json.dumps(document))
        except ValueError:
            print("refused")
    """
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout == "refused\n"


def test_whole_numbers_are_kept():
    tree = dataclasses.replace(random_tree(np.random.default_rng(0), ACTIONS["discrete"]), integers=(2, 0))
    assert tree.integers == (0, 2)
    assert DecisionTree.from_json(tree.to_json()) == tree
    with pytest.raises(ValueError, match="true, or left out"):
        DecisionTree.from_json(tree.to_json().replace('"integer": true', '"integer": 1'))


def test_whole_numbers_are_features_without_a_group():
    tree = random_grouped_tree(np.random.default_rng(0), ACTIONS["discrete"])
    with pytest.raises(ValueError, match="in a group"):
        dataclasses.replace(tree, integers=tree.groups[0].features)
    with pytest.raises(ValueError, match="positions of the 6 features, got 6"):
        dataclasses.replace(tree, integers=(6,))
