"""Explanations against brute force: all subsets of features, all cells of the grid of thresholds."""

from dataclasses import replace
from itertools import chain, combinations, product
from typing import Any

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group
from sympol.trees.explain import NORMS, Explanation, Norm, explain, explanation_features, nearest
from sympol.trees.explain.sufficient_reason import smallest_hitting_set

from .samples import (
    ACTIONS,
    HOSTILE_NAMES,
    consistent,
    every_cell,
    random_grouped_tree,
    random_tree,
    within_bounds,
)

SEEDS = 8


def with_integers(tree: DecisionTree, rng: np.random.Generator) -> DecisionTree:
    """The same tree over whole numbers, with thresholds between and on them."""
    inner, threshold = ~tree.is_leaf, tree.threshold.copy()
    threshold[inner] = rng.choice(np.float32([-2, -1.5, -0.5, 0, 0.5, 1, 1.25, 1.75]), inner.sum())
    low = np.where(np.isfinite(tree.feature_low), -2.5, -np.inf)
    high = np.where(np.isfinite(tree.feature_high), 2, np.inf)
    return replace(tree, threshold=threshold, integers=(0, 2), feature_low=low, feature_high=high)


def cases():
    """Trees of all kinds, and a few observations of each: in bounds, and where there are no groups out of them."""
    for kind in ACTIONS:
        for seed in range(SEEDS):
            rng = np.random.default_rng(seed)
            free = random_tree(rng, ACTIONS[kind], depth=3)
            for tree in (free, with_integers(free, rng)):
                yield tree, rng.normal(size=(3, 3)).astype(np.float32) * 1.5
            grouped = random_grouped_tree(rng, ACTIONS[kind], depth=4)
            x = consistent(grouped, every_cell(grouped, nan=False))
            yield grouped, rng.choice(x[np.isfinite(x).all(axis=1)], 3)


def worlds(tree: DecisionTree, x: np.ndarray) -> np.ndarray:
    """One observation of each cell that the space has, with the values of x as well, in all combinations of units."""
    axes = []
    for unit in explanation_features(tree):
        if unit.group is not None:
            values = np.eye(len(unit.positions), dtype=np.float32)
            low, high = tree.feature_low[list(unit.positions)], tree.feature_high[list(unit.positions)]
            fits = ((values >= low) & (values <= high)).all(axis=1)
            values = np.concatenate([values[fits] if fits.any() else values, x[None, list(unit.positions)]])
        else:
            i = unit.positions[0]
            t = np.unique(tree.threshold[tree.feature == i])
            above = np.where(
                t == 0, np.finfo(np.float32).smallest_normal, np.nextafter(t, np.float32(np.inf))
            )
            low, high = tree.feature_low[i], tree.feature_high[i]
            far = np.float32([-9, 9])
            grid = np.concatenate([t, above, far, [low, high]])
            if i in tree.integers:
                grid = np.concatenate([np.floor(grid), np.ceil(grid), np.floor(grid) + 1])
            grid = grid[(grid >= low) & (grid <= high) & np.isfinite(grid)]
            if i in tree.integers:
                grid = grid[grid == np.round(grid)]
            values = np.unique(np.concatenate([grid, [x[i]]]).astype(np.float32))[:, None]
        axes.append(values)
    rows = [np.concatenate(parts) for parts in product(*axes)]
    order = np.argsort([f for unit in explanation_features(tree) for f in unit.positions])
    return np.array(rows, np.float32)[:, order]


def flat(actions: np.ndarray) -> np.ndarray:
    return actions.reshape(len(actions), -1)


def forces(tree: DecisionTree, x: np.ndarray, worlds: np.ndarray, some: tuple[int, ...]) -> bool:
    """Whether these units, as they are in x, leave no other action, whatever the others are."""
    y = worlds.copy()
    for i in some:
        features = list(explanation_features(tree)[i].positions)
        y[:, features] = x[features]
    return bool((flat(tree.predict(y)) == flat(tree.predict(x[None]))).all())


def test_a_reason_forces_the_action_and_nothing_smaller_does():
    lengths = set()
    for tree, observations in cases():
        units = explanation_features(tree)
        for x in observations:
            reason, y = explain(tree, x).reason, worlds(tree, x)

            found = tuple(i for i, unit in enumerate(units) if unit in reason.features)
            sizes = chain.from_iterable(combinations(range(len(units)), k) for k in range(len(found)))
            assert forces(tree, x, y, found)
            assert not any(forces(tree, x, y, some) for some in sizes)
            lengths.add(len(found))
    assert lengths >= {0, 1, 2, 3}


def distances(tree: DecisionTree, x: np.ndarray, y: np.ndarray, norm: Norm, scales: np.ndarray) -> np.ndarray:
    each = []
    for unit, scale in zip(explanation_features(tree), scales, strict=True):
        difference = np.abs(y[:, unit.positions].astype(float) - x[list(unit.positions)]).max(axis=1)
        each.append((difference != 0) / scale if unit.group else difference / scale)
    away = np.stack(each)
    return {"l1": away.sum(axis=0), "l0": np.count_nonzero(away, axis=0), "linf": away.max(axis=0)}[norm]


@pytest.mark.parametrize("norm", NORMS)
def test_nothing_nearer_gets_another_action(norm: Norm):
    some, none = 0, 0
    for tree, observations in cases():
        units = explanation_features(tree)
        rng = np.random.default_rng(tree.n_nodes)
        for x in observations:
            scales = rng.choice([1.0, 0.5, 3.0], len(units))
            fixed = [i for i in range(len(units)) if rng.random() < 0.2]
            names = [unit.positions[0] for unit in units]
            explained = explain(
                tree,
                x,
                norm=norm,
                scale=dict(zip(names, scales.tolist(), strict=True)),
                immutable=[names[i] for i in fixed],
            )
            y = worlds(tree, x)
            for i in fixed:
                features = list(units[i].positions)
                y = y[(y[:, features] == x[features]).all(axis=1)]
            actions, away = flat(tree.predict(y)), distances(tree, x, y, norm, scales)
            asked = [np.ravel(one.action).tolist() for one in explained.counterfactuals]
            # every action that can be had was asked for
            had = {tuple(row) for row in actions.tolist()} - {tuple(flat(tree.predict(x[None]))[0].tolist())}
            assert had <= {tuple(action) for action in asked}
            assert [one.distance for one in explained.counterfactuals] == sorted(
                one.distance for one in explained.counterfactuals
            )
            for one in explained.counterfactuals:
                gets = (actions == np.ravel(one.action)).all(axis=1)
                if one.observation is None:
                    assert not gets.any()
                    none += 1
                    continue
                some += 1
                np.testing.assert_array_equal(tree.predict(one.observation), one.action)
                assert one.distance == pytest.approx(away[gets].min(), rel=1e-12)
                said = distances(tree, x, one.observation[None], norm, scales)[0]
                assert said == pytest.approx(one.distance, rel=1e-12)
                possible(tree, x, one.observation, fixed)
    assert some > 100
    assert none > 10


def possible(tree: DecisionTree, x: np.ndarray, y: np.ndarray, fixed: list[int]) -> None:
    """What changed is in the space, and what must not change did not."""
    assert y.dtype == np.float32
    assert len(consistent(tree, y[None]))
    for i, unit in enumerate(explanation_features(tree)):
        features = list(unit.positions)
        if (y[features] == x[features]).all():
            continue
        assert i not in fixed
        if unit.group is None:
            assert len(
                within_bounds(
                    replace(
                        tree,
                        feature_low=np.where(
                            np.arange(tree.n_features) == features[0], tree.feature_low, -np.inf
                        ),
                        feature_high=np.where(
                            np.arange(tree.n_features) == features[0], tree.feature_high, np.inf
                        ),
                    ),
                    y[None],
                )
            )
            assert features[0] not in tree.integers or y[features[0]] == np.round(y[features[0]])


def test_of_equally_near_ones_fewer_changes_win_and_then_the_smaller_sum():
    tree = DecisionTree.from_text(
        """
        a < 1
         yes: stay
         no: b < 1
          yes: b < 0.125
           yes: stay
           no: c < 0.125
            yes: stay
            no: go
          no: go
        """,
        actions=DiscreteActions(2, ("stay", "go")),
        feature_names=["a", "b", "c"],
    )
    # a = 1, b = c = 0.125 is as far and sums up to less, but changes more
    assert explain(tree, [0, 0, 0], norm="linf").counterfactuals[0].changes == (
        "a = 1 instead of 0",
        "b = 1 instead of 0",
    )
    # both change one thing, and by that count are equally far
    line = DecisionTree.from_text(
        "a < -3\n yes: go\n no: a < 1\n  yes: stay\n  no: go", actions=tree.actions, feature_names=["a"]
    )
    assert explain(line, [0], norm="l0").counterfactuals[0].changes == ("a = 1 instead of 0",)


def test_wanted_actions_may_be_any(pendulum):
    x = [0.0, 0.5, 0.0]
    assert nearest(pendulum, x, lambda torque: torque >= 0.5).changes == (  # pyright: ignore
        "sin θ = 0 instead of 0.5",
    )
    assert nearest(pendulum, x, lambda torque: torque <= -1).distance == 0  # pyright: ignore
    assert nearest(pendulum, x, lambda torque: torque > 1) is None
    assert nearest(pendulum, x, lambda torque: torque >= 0.5, immutable=["sin θ"]) is None


def test_what_is_said_reads_well(front):
    x = [0.5, 0, 0, 1, 0, 2]
    explained = explain(front, x)
    assert explained.sentence == "turn right, because front is lava and steps > 0.25."
    assert explained.reason_sentence == "front is lava alone forces it."
    assert [one.words for one in explained.counterfactuals] == [
        "turn left, if front is wall instead of lava",
        "move forward: not by any change",
    ]
    assert str(explained).splitlines()[:2] == [explained.sentence, explained.reason_sentence]
    plain = explained.to_dict()
    assert plain["reason"] == {"features": ["front"], "words": "front is lava"}
    assert set(plain["counterfactuals"][0]) == {"action", "answer", "observation", "distance", "changes"}


def test_a_tree_of_one_answer_needs_no_reason():
    tree = DecisionTree.from_text("go", actions=DiscreteActions(2, ("go", "stop")), feature_names=["x"])
    explained = explain(tree, [1.0])
    assert explained.sentence == "go, always."
    assert explained.reason_sentence == "Nothing is needed for go: no observation gets another action."
    assert [one.words for one in explained.counterfactuals] == ["stop: not by any change"]
    assert explained.to_dict()["counterfactuals"][0]["distance"] is None


def test_subnormal_numbers_are_zero_and_actions_that_are_minus_zero_are_zero():
    tree = DecisionTree.from_complete(
        np.array([0, 0, 0]), np.float32([0, -1, 1]), np.float32([[0.0], [1], [-0.0], [1]]),
        actions=BoxActions(-1, 1, (1,)), feature_names=["x"],  # pyright: ignore
    )  # fmt: skip
    explained = explain(tree, [1e-40])
    assert explained.observation[0] == 0
    assert explained.answer == "action = 1"
    assert len(explained.counterfactuals) == 1
    assert explained.counterfactuals[0].observation == np.finfo(np.float32).smallest_normal


def test_strangers_names_stay_on_one_line():
    n = len(HOSTILE_NAMES)
    tree = DecisionTree.from_complete(
        np.arange(3), np.zeros(3), np.eye(n)[:4], actions=DiscreteActions(n, tuple(HOSTILE_NAMES)),
        feature_names=HOSTILE_NAMES,
    )  # fmt: skip
    explained = explain(tree, np.ones(n))
    assert len(str(explained).split("\n")) == 2 + n - 1
    assert str(explained).isprintable() or {c for c in str(explained) if not c.isprintable()} == {"\n"}


@pytest.mark.parametrize(
    ("observation", "options", "message"),
    [
        ([0, 0, 0], {}, r"shape \[4\]"),
        ([[0, 0, 0, 0]], {}, r"expected one observation \[4\], got 1"),
        ([0, 0, np.nan, 0], {}, "must be finite, got nan for 'pole angle'"),
        ([0, 0, 0, 1e39], {}, "must be finite, got inf for 'pole angular velocity'"),
        ([0, 0, 0, 0], {"norm": "l2"}, "norm must be one of l1, l0, linf, got 'l2'"),
        (
            [0, 0, 0, 0],
            {"immutable": ["pole angel"]},
            "unknown feature 'pole angel'; did you mean 'pole angle'",
        ),
        ([0, 0, 0, 0], {"immutable": [4]}, "a feature must be from 0 to 3, got 4"),
        (
            [0, 0, 0, 0],
            {"scale": {"pole angle": 0}},
            "scale of 'pole angle' must be positive and finite, got 0",
        ),
        ([0, 0, 0, 0], {"scale": {"pole angle": np.nan}}, "must be positive and finite"),
        ([0, 0, 0, 0], {"scale": {"angle": 1}}, "unknown feature 'angle'"),
    ],
)
def test_what_cannot_be_explained_is_said(cartpole, observation: Any, options: dict[str, Any], message: str):
    with pytest.raises(ValueError, match=message):
        explain(cartpole, observation, **options)


def test_groups_are_named_by_their_names_and_by_their_features(front):
    x = [0.5, 0, 0, 1, 0, 2]
    for name in ("front", "front is lava", 3):
        fixed = explain(front, x, immutable=[name])
        assert all(one.observation is None or one.observation[3] == 1 for one in fixed.counterfactuals)
    unnamed = replace(front, groups=(Group("", front.groups[0].features, front.groups[0].categories),))
    assert explain(unnamed, x).reason.names == ("empty/wall/lava/goal",)
    with pytest.raises(ValueError, match="must be a single 1 and otherwise 0"):
        explain(front, [0.5, 1, 0, 1, 0, 2])


def test_smallest_hitting_sets_are_smallest():
    rng = np.random.default_rng(0)
    for _ in range(300):
        n = int(rng.integers(1, 9))
        sets = rng.integers(1, 2**n, int(rng.integers(0, 12))).tolist()
        found = sum(1 << i for i in smallest_hitting_set(sets))
        hits = [some for some in range(2**n) if all(some & one for one in sets)]
        assert found in hits
        assert found.bit_count() == min(some.bit_count() for some in hits)
    with pytest.raises(ValueError, match="cannot be hit"):
        smallest_hitting_set([1, 0])


def test_large_trees_are_explained_at_once():
    rng = np.random.default_rng(0)
    tree = random_tree(rng, ACTIONS["discrete"], depth=8, n_features=40)
    for x in rng.normal(size=(20, 40)):
        explained = explain(tree, x)
        assert isinstance(explained, Explanation)
        assert 0 < len(explained.reason.features) <= 8
