"""Verdicts against brute force over every cell that observations can fall into, NaN and infinities among them."""

import json
from pathlib import Path

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions
from sympol.trees.boxes import space
from sympol.trees.verify import Property, action_range, possible_actions, verify

from ..samples import ACTIONS, random_tree
from .questions import (
    as_text,
    decided,
    every_kind_of_observation,
    is_true,
    random_case,
    random_claim,
    random_condition,
    truth,
)

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("grouped", [False, True])
@pytest.mark.parametrize("bounds", [False, True])
def test_rules_hold_where_no_observation_is_against_them(grouped, bounds):
    rng = np.random.default_rng([3, grouped, bounds])
    held = []
    for _ in range(40):
        tree = random_case(rng, grouped=grouped, depth=2)
        condition, claim = random_condition(rng, tree, depth=1), random_claim(rng, tree)
        x = every_kind_of_observation(tree, condition)
        x = x[space(tree, bounds=bounds).contains(x)[0]]
        x = x[[truth(condition, row, tree) for row in x]]
        right = {
            int(leaf): is_true(claim, decided(tree, leaf), tree) for leaf in np.flatnonzero(tree.is_leaf)
        }
        ends = np.atleast_1d(tree.apply(x)) if len(x) else np.zeros(0, int)
        names = ("action",) if isinstance(tree.actions, DiscreteActions) else tree.actions.names
        rule = f"when {as_text(condition, tree, tree.feature_names)} then {as_text(claim, tree, names)}"
        (verdict,) = verify(tree, [Property(rule, within_bounds=bounds)])
        assert verdict.holds == all(right[int(leaf)] for leaf in ends), rule
        assert verdict.vacuous == (len(x) == 0), rule
        assert verdict.n_leaves == len({*ends.tolist()})
        assert verdict.n_violating == len({leaf for leaf in ends.tolist() if not right[leaf]})
        held.append(verdict.holds)
        if not verdict.holds:
            found = verdict.counterexample
            assert found is not None
            assert truth(condition, found, tree)
            assert not right[int(tree.apply(found))]
            assert space(tree, bounds=bounds).contains(found[None]).all()
    assert 5 < sum(held) < 35


def test_monotonicity_does_not_depend_on_how_many_pairs_are_looked_at_at_once(monkeypatch):
    rng = np.random.default_rng(8)
    for _ in range(5):
        tree = random_tree(rng, ACTIONS["box"], depth=5)
        whole, *_ = tree.verify("gas is increasing in x[0]")
        monkeypatch.setattr("sympol.trees.verify.checks._PAIRS_AT_ONCE", 7)
        parts, *_ = tree.verify("gas is increasing in x[0]")
        monkeypatch.undo()
        assert (parts.holds, parts.n_violating) == (whole.holds, whole.n_violating)
        for one, other in zip(parts.examples, whole.examples, strict=True):
            assert np.count_nonzero(one.observation[1:]) == np.count_nonzero(other.observation[1:])


def test_verdicts_say_what_was_proven_and_what_not(cartpole):
    holds, fails, vacuous = cartpole.verify(
        "when pole angle > 0.1 and pole angular velocity > 0.5 then action is push right",
        Property("action is never push left", "always right"),
        "when pole angle > 1 then action is push left",
    )
    assert str(holds).endswith("then action is push right: holds: proven for 1 leaf")
    assert str(fails) == (
        "always right: fails in 2 of 4 leaves: cart position = 0, cart velocity = 0, pole angle = 0, "
        "pole angular velocity = -0.05: push left"
    )
    assert vacuous.holds
    assert vacuous.words == "holds vacuously: no observation meets the condition"
    assert vacuous.n_leaves == 0


def test_nan_counts_only_outside_the_bounds_and_where_nothing_is_said_of_it(pendulum):
    # NaN goes right, as +inf does: there the torque is -2
    at_most = Property("when sin θ <= 0 then torque > 0", within_bounds=False)
    assert pendulum.verify(at_most)[0].holds
    not_greater = Property("when not sin θ > 0 then torque > 0", within_bounds=False)
    assert pendulum.verify(not_greater)[0].holds, "the opposite of greater is at most, which NaN is not"
    assert pendulum.predict([np.nan, np.nan, np.nan]) == [-2]


def test_a_condition_may_be_met_by_nan_in_other_features():
    """x may be NaN where only y is spoken of: right of x <= FLT_MAX are +inf and NaN."""
    largest = np.finfo(np.float32).max
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([largest]), np.eye(2), actions=DiscreteActions(2), feature_names=["x", "y"]
    )
    everywhere = Property("when y > 0 then action is 0", within_bounds=False)
    (verdict,) = tree.verify(everywhere)
    assert verdict.counterexample is not None
    assert verdict.counterexample[0] == np.inf
    (finite,) = tree.verify(
        Property(f"when y > 0 and x <= {largest:.0f} then action is 0", within_bounds=False)
    )
    assert finite.holds


def test_monotone_is_proven_and_refuted_by_a_pair(pendulum, cartpole):
    falls, rises = pendulum.verify("torque is decreasing in sin θ", "torque is increasing in sin θ")
    assert falls.holds
    assert not rises.holds
    x, y = (example.observation for example in rises.examples)
    assert x[1] < y[1]
    assert (np.delete(x, 1) == np.delete(y, 1)).all()
    assert pendulum.predict(x) > pendulum.predict(y)
    assert "; then " in rises.words
    assert pendulum.verify("when sin θ > 0 then torque is increasing in sin θ")[0].holds
    assert cartpole.verify("action is increasing in pole angle")[0].holds
    assert not cartpole.verify("action is decreasing in pole angle")[0].holds
    assert cartpole.verify("action is increasing in pole angular velocity")[0].holds


@pytest.mark.parametrize("grouped", [False, True])
def test_possible_actions_are_those_that_observations_get(grouped):
    rng = np.random.default_rng([7, grouped])
    for _ in range(30):
        tree = random_case(rng, grouped=grouped, depth=2)
        condition = random_condition(rng, tree, depth=1)
        x = every_kind_of_observation(tree, condition)
        x = x[space(tree, bounds=True).contains(x)[0]]
        x = x[[truth(condition, row, tree) for row in x]]
        when = as_text(condition, tree, tree.feature_names)
        found = possible_actions(tree, when)
        expected = np.unique(tree.predict(x), axis=0) if len(x) else found[:0]
        assert np.array_equal(found, expected)
        if isinstance(tree.actions, BoxActions):
            ends = action_range(tree, when)
            assert bool(ends) == bool(len(x))
            for i, (low, high) in enumerate(ends.values()):
                numbers = expected.reshape(len(expected), -1)[:, i]
                assert (low, high) == (numbers.min(), numbers.max())
        else:
            with pytest.raises(TypeError, match="only continuous actions have a range"):
                action_range(tree, when)


def test_verify_takes_rules_properties_and_files(cartpole, tmp_path):
    file = tmp_path / "safety.toml"
    file.write_text(
        '[[property]]\nname = "right"\nrule = "when pole angle > 0.1 and pole angular velocity > 0 then action is 1"\n'
        '[[property]]\nrule = "when pole angle > 1 then action is 0"\nwithin_bounds = false\n',
        encoding="utf-8",
    )
    verdicts = cartpole.verify(file, "action is one of 0, 1", Property("action is 0", "left"))
    assert [verdict.name for verdict in verdicts] == [
        "right",
        "when pole angle > 1 then action is 0",
        "action is one of 0, 1",
        "left",
    ]
    assert [verdict.holds for verdict in verdicts] == [True, False, True, False]
    with pytest.raises(ValueError, match="property 'left': unknown feature 'angle'"):
        cartpole.verify(Property("when angle > 1 then action is 0", "left"))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "must hold .*property.* got nothing"),
        ("rule = 'x'", "got 'rule'"),
        ("property = 3", "must hold"),
        ("[[property]]\nname = 'x'", "property 1 of .* has no rule"),
        ("[[property]]\nrule = 'x'\nwithin_bound = true", "unknown key 'within_bound'; there are name, rule"),
        ("[[property]]\nrule = 3", "rule must be a string, got 3"),
        ("[[property]]\nrule = 'x'\nwithin_bounds = 1", "within_bounds must be true or false, got 1"),
        ("[[property]", "is not TOML"),
        ("\ud800", "is not TOML"),
    ],
)
def test_files_that_hold_no_properties_are_refused(cartpole, tmp_path, text, problem):
    file = tmp_path / "safety.toml"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(ValueError, match=problem):
        cartpole.verify(file)
    with pytest.raises(FileNotFoundError):
        cartpole.verify(Path(tmp_path / "nothing.toml"))


def test_the_program_in_the_documentation_runs(cartpole, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("policy.json").write_text(cartpole.to_json(), encoding="utf-8")
    page = (ROOT / "docs" / "guides" / "verify.md").read_text(encoding="utf-8")
    properties = page.split("```toml\n")[1].split("```")[0]
    Path("safety.toml").write_text(properties, encoding="utf-8")
    exec(page.split("```python\n")[1].split("```")[0], {})
    said = capsys.readouterr().out
    assert "action is never push left: fails in 2 of 4 leaves: cart position = 0" in said
    assert "far right: holds: proven for 2 leaves\n" in said
    assert said.endswith("[0 1]\n")


def test_the_documentation_says_what_was_measured():
    page = (ROOT / "docs" / "guides" / "verify.md").read_text(encoding="utf-8")
    measured = json.loads((ROOT / "studies" / "results" / "verify.json").read_text(encoding="utf-8"))
    agreement = measured["agreement"]
    assert f"Of {agreement['pairs']:,} random pairs" in page
    assert f"{agreement['disagreements']} were answered otherwise" in page
    assert agreement["disagreements"] == 0
    for question, milliseconds in measured["milliseconds"].items():
        assert f"| {question} | {milliseconds:.1f} |" in page
    for question, both in measured["beside_z3"].items():
        assert f"| {question} | {both['our_milliseconds']:.0f} | {both['z3_milliseconds']:,.0f} |" in page
