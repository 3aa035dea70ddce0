"""Trees and rules of strangers: however deep or large, they are a tree or one line, soon and in little memory."""

from __future__ import annotations

import contextlib
import copy
import json
import pickle
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from sympol.cli.tree_io import tree_from
from sympol.runs.metadata import RunError
from sympol.trees import BoxActions, DecisionTree, DiscreteActions, MultiDiscreteActions
from sympol.trees.diff import diff
from sympol.trees.explain.sufficient_reason import smallest_hitting_set
from sympol.trees.override import nodes_reached_by, override
from sympol.trees.text import leaf_conditions, rules
from sympol.trees.verify import Property, equal, read_properties

from .samples import chain

ACTIONS = 'features = ["a", "b"]\nactions = ["go", "stay"]\n'
DEEP = 5000
ROOT = Path(__file__).parents[2]


def in_two_gigabytes(code: str) -> str:
    """Run a program that may take that much memory; return what it says."""
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_AS, (2 * 2**30,) * 2)\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", limited], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.parametrize("brackets", [("[", "]"), ('{"a":', "}")])
@pytest.mark.parametrize("depth", [150, 900, 100_000])
def test_json_that_nests_deeply_is_refused_wherever_it_does(cartpole, brackets, depth):
    opened, closed = brackets
    for value in (opened * depth + "1" + closed * depth, opened * depth):
        for text in (value, cartpole.to_json().replace('{"env": "CartPole-v1"}', '{"env": ' + value + "}")):
            with pytest.raises(ValueError, match=r"nests too deeply|not JSON"):
                DecisionTree.from_json(text)


@pytest.mark.parametrize(
    "header",
    [
        "meta = 5",
        "meta = [1]",
        "meta = {day = 2020-01-01}",
        "meta = {x = nan}",
        "meta = " + "[" * 9999,
        "meta = " + "{a = " * 9999,
        "meta" + ".a" * DEEP + " = 1",
        'meta."a' + '"."=' * DEEP + '" = 1',
        "[meta" + ".a" * DEEP + "]",
        "meta = {" + "a." * 50_000 + "a = 1}",
        "groups" + ".a" * DEEP + " = 1",
        "env" + ".a" * DEEP + " = 1",
        "meta = {n = " + "9" * 5000 + "}",
        "meta = {n = 0x" + "f" * 50_000 + "}",
    ],
    ids=lambda header: header[:20],
)
def test_a_header_that_is_none_is_one_error(header):
    start = time.process_time()
    for text in (f"+++\n{ACTIONS}{header}\n+++\ngo", f"+++\n{header}\n+++\ngo"):
        with pytest.raises(ValueError, match=r"the header|nothing says|expected|unknown") as error:
            DecisionTree.from_text(text, actions=DiscreteActions(2, ("go", "stay")), feature_names=["a", "b"])
        assert len(str(error.value)) < 500
    assert time.process_time() - start < 2


@pytest.mark.parametrize(
    "content",
    [
        "property" + ".a" * DEEP + " = 1",
        "[[property]]\nrule" + ".a" * DEEP + " = 1",
        "[[property]]\nrule = " + "[" * 9999,
        "[[property]]\nrule = '''" + "x" * 2_000_000 + "'''",
        "[" + "a." * 50_000 + "a]",
        "x = " + "9" * 5000,
    ],
    ids=lambda content: content[:30],
)
def test_a_file_of_properties_that_is_none_is_one_error(tmp_path, content):
    file = tmp_path / "safety.toml"
    file.write_text(content)
    with pytest.raises(ValueError, match=r"safety\.toml") as error:
        read_properties(file)
    assert len(str(error.value)) < 500 + len(str(file))


def test_a_file_of_properties_may_begin_with_a_byte_order_mark(tmp_path):
    file = tmp_path / "safety.toml"
    file.write_text('[[property]]\nrule = "action is 1"\n', encoding="utf-8-sig")
    assert read_properties(file) == (Property("action is 1"),)


@pytest.mark.parametrize("nested", ["not " * 950, "not " * 200, "(" * 300, "not (" * 400])
def test_a_condition_that_nests_deeply_is_refused(cartpole, nested):
    condition = f"{nested}pole angle > 0{')' * nested.count('(')}"
    for asked in (
        lambda: cartpole.verify(f"when {condition} then action is 1"),
        lambda: cartpole.verify(f"{nested}action is 1{')' * nested.count('(')}"),
        lambda: override(cartpole, condition, 1),
        lambda: nodes_reached_by(cartpole, condition),
    ):
        with pytest.raises(ValueError, match="the rule nests too deeply"):
            asked()
    (verdict,) = cartpole.verify(
        "when " + "not (" * 50 + "pole angle > 0" + ")" * 50 + " then action is one of 0, 1"
    )
    assert verdict.holds


@pytest.mark.parametrize(
    "words",
    [
        "pole angle <= " + "1" * 100_000 + "x",
        "pole angle" + " " * 100_000 + "x",
        "push left" + "  1" * 30_000,
        "x" * 200_000,
        "pole angle <= " + "1." * 50_000,
    ],
    ids=lambda words: words[:16],
)
def test_long_lines_are_soon_refused(cartpole, words):
    start = time.process_time()
    for text in (words, f"{words}\n  yes: push left\n  no: push right"):
        with pytest.raises(ValueError, match="line 1") as error:
            DecisionTree.from_text(text, like=cartpole)
        assert len(str(error.value)) < 500
    assert time.process_time() - start < 3


@pytest.mark.parametrize("words", ["1" * 9000 + "x", "pole angle" + " " * 9000 + "x"])
def test_long_rules_are_soon_refused(cartpole, words):
    start = time.process_time()
    with pytest.raises(ValueError, match="of the rule"):
        cartpole.verify(f"when {words} then action is 1")
    assert time.process_time() - start < 2


@pytest.mark.parametrize("to_left", [True, False])
def test_a_chain_is_written_in_little_memory_or_refused(tmp_path, to_left):
    """3.7 MB of JSON would be 10 GB as a listing."""
    tree = chain(40_000, to_left=to_left, actions=DiscreteActions(2))
    (tmp_path / "policy.json").write_text(tree.to_json())
    assert (tmp_path / "policy.json").stat().st_size > 3.7e6
    said = in_two_gigabytes(f"""if True:
        from sympol.trees import DecisionTree
        tree = DecisionTree.from_json(open({str(tmp_path / "policy.json")!r}).read())
        try:
            tree.to_text()
        except ValueError as error:
            print(error)
        print(len(tree.rules()), len(tree.export("markdown")) > 0, len(tree.export("latex")) > 0)
    """)
    assert said.startswith(
        "the tree is too deep to be written for people: it would take more than 100,000,000"
    )
    assert said.endswith("40001 True True\n")


def test_what_takes_memory_with_the_square_of_a_file_is_refused():
    """As many features as nodes, all of them asked about on the way to the last leaf."""
    said = in_two_gigabytes("""if True:
        import numpy as np
        from dataclasses import replace
        from tests.trees.samples import chain
        from sympol.trees import DecisionTree, DiscreteActions
        n = 12_000
        tree = chain(n, to_left=True, actions=DiscreteActions(2))
        feature = tree.feature.copy()
        feature[~tree.is_leaf] = np.arange(n)
        tree = replace(tree, feature=feature, feature_names=[str(i) for i in range(n)],
                       feature_low=np.full(n, -np.inf), feature_high=np.full(n, np.inf))
        for work in (lambda: tree.verify("action is 1"), lambda: tree.explain(np.zeros(n))):
            try:
                work()
            except ValueError as error:
                print(error)
    """)
    assert said.count("more than fits into memory; prune the tree") == 2


def test_names_are_not_so_long_that_their_use_fills_the_memory():
    tree = chain(20_000, to_left=False, actions=DiscreteActions(2))
    for changed in (
        {"feature_names": ("x" * 100_000,)},
        {"actions": DiscreteActions(2, ("x" * 100_000, "y"))},
    ):
        with pytest.raises(
            ValueError, match="a name has at most 10,000 characters, got one of 100,000: 'xxx"
        ):
            replace(tree, **changed)
    with pytest.raises(ValueError, match="would be written 200,160,008 characters long"):
        replace(tree, feature_names=("x" * 10_000,))
    multi = MultiDiscreteActions((1,) * 1000, options=(("x" * 100,),) * 1000)
    with pytest.raises(ValueError, match="give shorter names"):
        replace(chain(2000, to_left=False, actions=DiscreteActions(1000)), actions=multi)


def test_a_tree_of_depth_500_works_everywhere():
    for to_left in (True, False):
        tree = chain(500, to_left=to_left, actions=DiscreteActions(2)).with_visits(
            np.linspace(-500, 500, 999)[:, None]
        )
        other = replace(tree, threshold=np.where(tree.threshold == 250, np.float32(250.25), tree.threshold))
        assert DecisionTree.from_json(tree.to_json()) == tree
        assert (DecisionTree.from_text(tree.to_text(), like=tree).threshold == tree.threshold).all()
        assert len(rules(tree)) == 501
        assert equal(tree, tree.prune()).holds
        assert tree.verify("when x > 3 then action is one of 0, 1")[0].holds
        assert tree.explain([3.0]).sentence
        assert diff(tree, tree).acts_alike
        assert diff(tree, other).acts_alike == (tree == other)
        assert DecisionTree.from_sklearn(tree.to_sklearn(names=False), tree.actions).depth == 500
        for to in ("python", "c", "rust", "javascript", "sql", "markdown", "dot", "mermaid", "latex"):
            assert tree.export(to)


def test_reasons_of_thousands_of_features_are_found():
    sets = [1 << i for i in range(3000)]
    assert smallest_hitting_set([*sets, (1 << 3001) | (1 << 3000), 3]) == (*range(3001),)


def test_what_the_way_to_a_leaf_tells_is_as_it_was(front, cartpole):
    """The conditions of each leaf, kept by copies here, by undoing there."""
    for tree in (front, cartpole):
        kept = [(leaf, {**known}) for leaf, known in leaf_conditions(tree)]
        assert [leaf for leaf, _ in kept] == [leaf for leaf, _ in leaf_conditions(tree)]
        assert sorted(leaf for leaf, _ in kept) == np.flatnonzero(tree.is_leaf).tolist()
        sentences = [" and ".join(one.words() for one in known.values()) for _, known in kept]
        assert [
            f"If {said}: " == rule[: len(said) + 5] for said, rule in zip(sentences, rules(tree), strict=True)
        ]


def test_files_with_a_byte_order_mark_are_read(cartpole, tmp_path):
    for name, text in (("a.json", cartpole.to_json()), ("a.txt", f"+++\n{ACTIONS}+++\ngo")):
        (tmp_path / name).write_text(text, encoding="utf-8")
        plain = tree_from(tmp_path / name)
        (tmp_path / name).write_text(text, encoding="utf-8-sig")
        assert tree_from(tmp_path / name) == plain
    assert DecisionTree.from_json("\ufeff" + cartpole.to_json()) == cartpole


@pytest.mark.parametrize("name", ["a.json", "a.txt"])
def test_a_file_without_end_is_refused(tmp_path, name):
    (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(RunError, match="not an ordinary file"):
        tree_from(tmp_path / name)


def arrays(tree: DecisionTree) -> list[np.ndarray]:
    return [value for field in fields(tree) if isinstance(value := getattr(tree, field.name), np.ndarray)]


@pytest.mark.parametrize(
    "copied", [lambda tree: pickle.loads(pickle.dumps(tree)), copy.copy, copy.deepcopy, replace],
    ids=["pickle", "copy", "deepcopy", "replace"],
)  # fmt: skip
def test_copies_are_equal_and_read_only(cartpole, front, copied):
    box = replace(cartpole, actions=BoxActions(-1, 1, (2,)))
    for tree in (cartpole, front, box):
        tree.predict(
            np.array([0, 1, 0, 0, 0, 0][: tree.n_features])
        )  # what follows is kept, and is not copied
        again = copied(tree)
        assert again == tree
        assert hash(again) == hash(tree)
        for array in (*arrays(again), again.is_leaf):
            assert not array.flags.writeable
            with pytest.raises(ValueError, match="read-only"):
                array[0] = array[0]


def test_json_larger_than_is_read_is_refused():
    with pytest.raises(ValueError, match="the JSON has 70,000,000 characters; at most 67,108,864 are read"):
        DecisionTree.from_json(" " * 70_000_000)


def test_documents_that_are_edited_at_random_are_a_tree_or_one_error(cartpole, front):
    rng = np.random.default_rng(0)
    odd = [None, 5, -1, 1e400, "x", "\x1b[31m", [], {}, [[]], True, 2**70, "9" * 400, {"a": [1]}, 0.5]
    for round_number in range(300):
        document = json.loads((cartpole, front)[round_number % 2].to_json())
        places = [document]
        for _ in range(int(rng.integers(1, 5))):
            place = places[-1]
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = keys[rng.integers(len(keys))]
            if isinstance(place[key], dict | list) and rng.random() < 0.7:
                places.append(place[key])
            else:
                place[key] = odd[rng.integers(len(odd))]
        with contextlib.suppress(ValueError):
            DecisionTree.from_json(json.dumps(document)).to_text()
