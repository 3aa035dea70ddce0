"""SA-DT, DAgger and VIPER: what they learn from, what they choose, and that they are any good."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, MultiDiscrete

from sympol.distill import METHODS, Demonstrations, Teacher, demonstrations, distill, imitate
from sympol.distill.dagger import dagger, draw_uniformly
from sympol.distill.imitate import Candidate, best_of, iteration_seed, on_gymnasium
from sympol.distill.sa_dt import sa_dt
from sympol.distill.viper import draw_by_loss, losses, viper
from sympol.play import episode_seed, play
from sympol.trees import DecisionTree
from sympol.trees.actions import DiscreteActions

from .teachers import CARTPOLE, PENDULUM, cartpole, chain, line, pendulum

QUICK: dict[str, Any] = {
    "num_iterations": 3,
    "episodes_per_iteration": 2,
    "num_validation_episodes": 2,
}


def mean_return(policy: Any, spec: Any) -> float:
    """Over 20 test episodes."""
    return float(play(policy, spec, 20, seed=0).returns.mean())


def always(action: int, spec: Any) -> DecisionTree:
    return DecisionTree.from_complete(
        np.zeros(0, int),
        np.zeros(0),
        np.eye(2)[[action]],
        actions=DiscreteActions(2),
        feature_names=spec.features.names,
    )


def test_each_tree_learns_from_what_all_before_it_came_by(monkeypatch: pytest.MonkeyPatch):
    """The teacher goes 0, 1, 2; the first tree goes left, 0, −1, −2; the second is right again."""
    spec, seeds = line()
    teacher = Teacher.from_callable(lambda o: 1, spec)
    fitted, scripted = [], [always(0, spec), always(1, spec), always(0, spec)]

    def fit(x: np.ndarray, actions: np.ndarray, *_: Any, **__: Any) -> DecisionTree:
        fitted.append((x[:, 0].tolist(), actions.tolist()))
        return scripted[len(fitted) - 1]

    monkeypatch.setattr("sympol.distill.imitate.fit_cart", fit)
    told = []
    chosen = dagger(
        teacher, num_iterations=3, episodes_per_iteration=2, num_validation_episodes=4, progress=told.append
    )
    right, left = [0, 0, 1, 1, 2, 2], [0, 0, -1, -1, -2, -2]  # two episodes side by side
    assert fitted == [
        (right, [1] * 6),
        (right + left, [1] * 12),
        (right + left + right, [1] * 18),
    ]
    assert chosen is scripted[1]
    assert told == [(1, 3, 6, 0, 0), (2, 3, 12, 3, 3), (3, 3, 18, 0, 3)]
    # every episode is new but those of the validation, which are the same for all, and none is a test's
    validation = [episode_seed(0, episode, "validation") for episode in range(4)]
    assert seeds[-12:] == validation * 3
    assert len({*seeds[-20:-12]}) == 8
    assert not {*validation} & {*seeds[-20:-12]}
    assert {seed % 2 for seed in seeds[-20:]} == {0}


@pytest.mark.parametrize("method", METHODS)
def test_a_limit_of_nodes_holds_and_the_depth_is_free_then(method: str):
    options = {"num_episodes": 4} if method == "sa-dt" else QUICK
    tree = distill(cartpole(), method, max_nodes=15, **options)
    assert tree.n_nodes <= 15
    assert tree.depth > 3  # a complete tree of 15 nodes has depth 3
    assert distill(cartpole(), method, depth=2, max_nodes=15, **options).depth <= 2


@pytest.mark.parametrize("max_nodes", [1, 0, 8, 7.0])
def test_numbers_of_nodes_that_no_tree_with_a_question_has_are_refused(max_nodes: Any):
    with pytest.raises(ValueError, match=rf"max_nodes must be .*, got {max_nodes}"):
        distill(cartpole(), "dagger", max_nodes=max_nodes)


def test_iterations_have_episodes_of_their_own():
    seeds = {iteration_seed(seed, i) for seed in range(30) for i in range(1, 50)}
    assert len(seeds) == 30 * 49


def test_of_the_best_candidates_validation_chooses_and_among_equals_the_later():
    spec, _ = line()
    teacher = Teacher.from_callable(lambda o: 1, spec)
    good, bad, also_good = always(1, spec), always(0, spec), always(1, spec)
    lucky = [Candidate(9, bad)] * 4
    assert best_of([Candidate(1, good), *lucky], on_gymnasium(teacher), 2, 0) is good
    assert (
        best_of([Candidate(1, good), *lucky, Candidate(9, bad)], on_gymnasium(teacher), 2, 0) is bad
    )  # no finalist
    assert (
        best_of([Candidate(1, good), Candidate(1, bad), Candidate(1, also_good)], on_gymnasium(teacher), 2, 0)
        is also_good
    )


def test_losses_are_those_of_a_plain_loop():
    rng = np.random.default_rng(0)
    q = rng.normal(size=(7, 5))
    spec = chain(Box(-1, 1, (1,)), MultiDiscrete([2, 3]))
    x = np.arange(7, dtype=np.float32)[:, None]
    teacher = Teacher(spec, lambda x: np.zeros((len(x), 2), int), lambda x: q[x[:, 0].astype(int)])
    expected = []
    for row in q:  # over all six joint actions, whose value is the sum of their components'
        joint = [row[i] + row[2 + j] for i in range(2) for j in range(3)]
        expected.append(max(joint) - min(joint))
    np.testing.assert_allclose(losses(teacher, x), expected)


def test_states_are_drawn_in_proportion_to_their_losses():
    n, weights = 4, np.array([0, 1, 3, 6.0])
    collected = Demonstrations(np.arange(n, dtype=np.float32)[:, None], np.arange(n) * 10, weights)
    drawn = np.zeros(n)
    for seed in range(4000):
        sample = draw_by_loss(collected, 3, np.random.default_rng(seed))
        assert sample.size == 3
        for x, action in zip(sample.observations[:, 0], sample.actions, strict=True):
            assert action == 10 * x
            drawn[int(x)] += 1
    expected = [12_000 * weight / sum(weights) for weight in weights]
    np.testing.assert_allclose(drawn, expected, atol=4 * 12_000**0.5 / 2)
    assert drawn[0] == 0
    assert draw_by_loss(collected, 99, np.random.default_rng(0)).size == n


def test_where_no_mistake_costs_anything_all_states_are_alike():
    collected = Demonstrations(np.arange(9, dtype=np.float32)[:, None], np.arange(9), np.zeros(9))
    assert len({*draw_by_loss(collected, 9, np.random.default_rng(0)).actions.tolist()}) > 3


def test_dagger_draws_without_repetition():
    collected = Demonstrations(np.arange(9, dtype=np.float32)[:, None], np.arange(9))
    assert draw_uniformly(collected, 9, np.random.default_rng(0)) is collected
    drawn = draw_uniformly(collected, 5, np.random.default_rng(0))
    assert len({*drawn.actions.tolist()}) == drawn.size == 5
    assert drawn.observations[:, 0].tolist() == drawn.actions.tolist()


def test_demonstrations_are_the_teachers_own_episodes():
    seen = demonstrations(cartpole(), 3, seed=7)
    assert seen.observations.shape == (1500, 4)
    np.testing.assert_array_equal(seen.actions, cartpole().act(seen.observations))
    again, other = demonstrations(cartpole(), 3, seed=7), demonstrations(cartpole(), 3, seed=8)
    np.testing.assert_array_equal(seen.observations, again.observations)
    assert (seen.observations[:3] != other.observations[:3]).any()


@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_tree(method: str):
    options = {"num_episodes": 3} if method == "sa-dt" else {**QUICK, "max_samples": 1500}
    trees = [distill(cartpole(), method, 4, seed, **options) for seed in (3, 3, 4)]
    assert trees[0] == trees[1] != trees[2]
    assert all(tree.depth <= 4 for tree in trees)
    assert trees[0].to_json() == trees[1].to_json()


def test_viper_keeps_a_pole_up():
    options = {"num_iterations": 6, "num_validation_episodes": 5}
    deep = viper(cartpole(), depth=8, seed=0, **options)
    shallow = viper(cartpole(), depth=5, seed=0, **options)
    assert mean_return(deep, CARTPOLE) > 490
    assert mean_return(shallow, CARTPOLE) > 470
    assert mean_return(sa_dt(cartpole(), depth=2), CARTPOLE) < mean_return(shallow, CARTPOLE)


def test_dagger_swings_a_pendulum_up_where_cloning_does_not():
    """Over 50 episodes, depth 8, two seeds: the teacher −149; cloned −546 and −850; dagger −173 and −176."""
    teacher = pendulum()
    ours = dagger(teacher, depth=8, num_iterations=8, num_validation_episodes=10)
    cloned = sa_dt(teacher, depth=8)
    assert mean_return(ours, PENDULUM) > -250
    assert mean_return(ours, PENDULUM) > mean_return(cloned, PENDULUM) + 200


def test_several_components_are_learnt_at_once():
    spec = chain(Box(-1, 1, (2,)), MultiDiscrete([2, 3], start=[1, 0]))
    teacher = Teacher.from_callable(
        lambda o: [1 + int(o[0] > 0), int(o[1] > -0.3) + int(o[1] > 0.3)], spec, lambda o: [0, 1, 0, 1, 2]
    )
    x = np.random.default_rng(0).uniform(-1, 1, (2000, 2)).astype(np.float32)
    for method in METHODS:
        tree = distill(teacher, method, 6)
        assert (tree.predict(x) == teacher.act(x)).all(axis=1).mean() > 0.95


def test_viper_names_what_would_fit():
    with pytest.raises(
        ValueError, match=r"viper needs a discrete action space, got Box.*use the method dagger"
    ):
        viper(pendulum())
    with pytest.raises(
        ValueError, match=r"viper needs a teacher with action values.*or use the method dagger"
    ):
        viper(Teacher.from_callable(lambda o: 0, CARTPOLE))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "cart"}, "method must be one of sa-dt, viper, dagger, got 'cart'"),
        ({"num_episodes": 5}, "viper has no option num_episodes; it has depth, num_iterations, "),
        ({"depth": 0}, "depth must be a whole number of at least 1, got 0"),
        ({"depth": 2.5}, "depth must be a whole number of at least 1, got 2.5"),
        ({"depth": 0, "method": "sa-dt"}, "depth must be"),
        ({"num_iterations": 0}, "num_iterations must be"),
        ({"episodes_per_iteration": -1, "method": "dagger"}, "episodes_per_iteration must be .* got -1"),
        ({"max_samples": True}, "max_samples must be"),
        ({"num_validation_episodes": 0}, "num_validation_episodes must be"),
        ({"num_episodes": 0, "method": "sa-dt"}, "num_episodes must be"),
        ({"seed": -1}, r"seed must be a whole number from 0 to 2\^32 - 1, got -1"),
        ({"seed": 2**32, "method": "sa-dt"}, "seed must be"),
    ],
    ids=str,
)
def test_bad_arguments_are_named(options: dict[str, Any], message: str):
    with pytest.raises(ValueError, match=message):
        distill(cartpole(), **options)


@pytest.mark.parametrize("method", METHODS)
def test_a_teacher_that_answers_nan_is_stopped_at_once(method: str):
    teacher = Teacher.from_callable(lambda o: float("nan"), CARTPOLE, lambda o: [0, 1])
    with pytest.raises(ValueError, match="finite, got nan for the observation"):
        distill(teacher, method)


def test_the_loop_refuses_to_be_called_without_iterations():
    with pytest.raises(ValueError, match="num_iterations must be"):
        imitate.Schedule(0, 1, 1, 1)
