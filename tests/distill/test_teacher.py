"""A teacher may be anything; what it answers is checked."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple

import sympol
from sympol.distill import Teacher
from sympol.distill.observations import unflatten
from sympol.distill.teacher import TINY
from sympol.envs.spaces import Features

from .teachers import CARTPOLE, PENDULUM, cartpole, chain

X = np.array([[0.1, -0.2, 0.3, 0.4], [1, 2, -3, 4]], np.float32)
ODD = Dict(
    {
        "box": Box(-1, 1, (2, 3)),
        "pixel": Box(0, 255, (2,), np.uint8),
        "kind": Discrete(3, start=-1),
        "pair": Tuple((MultiBinary(2), MultiDiscrete([2, 3], start=[1, 0]))),
    }
)


def same(a: Any, b: Any) -> None:
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        a, b = tuple(a.values()), tuple(b.values())
    if isinstance(a, tuple):
        for p, q in zip(a, b, strict=True):
            same(p, q)
        return
    assert np.asarray(a).dtype == np.asarray(b).dtype
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    "space",
    [ODD, Box(-1, 1, (2, 2)), Box(-1, 1, (), np.float64), Discrete(4, start=2), MultiDiscrete([[2, 3], [2, 2]])],
    ids=str,
)  # fmt: skip
def test_observations_come_back_from_their_features(space: gymnasium.Space):
    space.seed(0)
    features = Features.of(space)
    samples = [space.sample() for _ in range(5)]
    if isinstance(space, Box) and space.dtype == np.float64:
        samples = [np.float64(np.float32(sample)) for sample in samples]
    rows = np.stack([features.flatten(sample) for sample in samples])
    for sample, row in zip(samples, rows, strict=True):
        same(unflatten(space, row), sample)
        assert space.contains(unflatten(space, row))
    np.testing.assert_array_equal(features.flatten(unflatten(space, rows)), rows)


def test_one_at_a_time_and_in_batches_are_the_same_teacher():
    seen = []

    def one(observation: np.ndarray) -> int:
        seen.append(observation)
        return int(observation[2] > 0)

    single = Teacher.from_callable(one, CARTPOLE, action_values=lambda o: [o[0], o[1]])
    many = Teacher.from_callable(
        lambda o: (o[:, 2] > 0).astype(np.int32), CARTPOLE, action_values=lambda o: o[:, :2], batched=True
    )
    assert single.act(X).tolist() == many.act(X).tolist() == [1, 0]
    assert single.act(X).dtype == many.act(X).dtype == np.int64
    assert [o.shape for o in seen] == [(4,)] * 4
    assert single.action_values is not None
    assert many.action_values is not None
    np.testing.assert_array_equal(single.action_values(X), X[:, :2])
    np.testing.assert_array_equal(many.action_values(X), X[:, :2])


def test_a_function_sees_what_the_environment_returns():
    spec = chain(ODD, Discrete(2))
    teacher = Teacher.from_callable(lambda o: int(ODD.contains(o)), spec)
    rows = np.stack([spec.features.flatten(ODD.sample()) for _ in range(3)])
    assert teacher.act(rows).tolist() == [1, 1, 1]


def test_continuous_actions_are_clipped_and_keep_the_shape_of_the_space():
    spec = chain(Box(-1, 1, (4,)), Box(-1, 1, (1, 2)))
    teacher = Teacher.from_callable(lambda o: o[None, :2], spec)
    np.testing.assert_array_equal(teacher.act(X), np.array([[[0.1, -0.2]], [[1, 1]]], np.float32))
    assert teacher.act(X).dtype == np.float32


def test_actions_start_where_the_space_does():
    spec = chain(Box(-1, 1, (4,)), Discrete(2, start=5))
    assert Teacher.from_callable(lambda o: 6, spec).act(X).tolist() == [6, 6]
    with pytest.raises(ValueError, match=r"must be from 5 to 6, got 1 for the observation \[0\.1"):
        Teacher.from_callable(lambda o: 1, spec).act(X)
    several = chain(Box(-1, 1, (4,)), MultiDiscrete([2, 3], start=[0, 1]))
    assert Teacher.from_callable(lambda o: [1, 3], several).act(X).tolist() == [[1, 3]] * 2
    with pytest.raises(ValueError, match=r"must be from \[0, 1\] to \[1, 3\], got \[1, 0\]"):
        Teacher.from_callable(lambda o: [1, 0], several).act(X)


def test_a_teacher_plays_wherever_an_agent_does():
    assert sympol.evaluate_policy(cartpole(), CARTPOLE, 3) == (500, 0)  # pyright: ignore


@pytest.mark.parametrize(
    ("answer", "spec", "message"),
    [
        (lambda o: float("nan"), CARTPOLE, r"finite, got nan for the observation \[0\.1.*; correct the teacher"),
        (lambda o: np.array([np.nan]), PENDULUM, r"finite, got \[nan\] for the observation"),
        (lambda o: 1.0, CARTPOLE, r"must be integers, got float64 .*int\(\.\.\.\)"),
        (lambda o: o[2] > 0, CARTPOLE, "in numbers, got"),
        (lambda o: "left", CARTPOLE, "in numbers, got"),
        (lambda o: None, CARTPOLE, "in numbers, got"),
        (lambda o: 2, CARTPOLE, r"must be from 0 to 1, got 2 for the observation"),
        (lambda o: -1, CARTPOLE, r"must be from 0 to 1, got -1 "),
        (lambda o: [0, 1], CARTPOLE, r"of shape \(\) for each of 2 observations, together \(2,\), got \(2, 2\)"),
        (lambda o: 0.5, PENDULUM, r"of shape \(1,\) for each of 2 .* the action space is Box"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_action_space_is_refused(answer: Any, spec: Any, message: str):
    with pytest.raises(ValueError, match=message):
        Teacher.from_callable(answer, spec).act(X[:, : len(spec.features.names)])


def test_ragged_answers_are_refused():
    spec = chain(Box(-1, 1, (4,)), MultiDiscrete([2, 2]))
    with pytest.raises(ValueError, match="in numbers, got"):
        Teacher.from_callable(lambda o: [0] * (1 + (o[0] > 0.5)), spec).act(X)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (lambda o: [0, -np.inf], r"action values that is finite, got \[0\.0, -inf\].*clip it"),
        (lambda o: [0, 1, 2], r"of shape \(2,\) for each of 2 .* there are 2 actions"),
    ],
)
def test_values_that_do_not_fit_are_refused(values: Any, message: str):
    teacher = Teacher.from_callable(lambda o: 0, CARTPOLE, action_values=values)
    assert teacher.action_values is not None
    with pytest.raises(ValueError, match=message):
        teacher.action_values(X)


def test_probabilities_become_finite_logarithms():
    teacher = Teacher.from_callable(lambda o: 0, CARTPOLE, action_probabilities=lambda o: [0.0, 1.0])
    assert teacher.action_values is not None
    np.testing.assert_allclose(teacher.action_values(X), [[np.log(TINY), 0]] * 2)
    wrong = Teacher.from_callable(lambda o: 0, CARTPOLE, action_probabilities=lambda o: [-2.0, 0.5])
    assert wrong.action_values is not None
    with pytest.raises(ValueError, match=r"from 0 to 1, got -2\.0; are they logits\?"):
        wrong.action_values(X)


def test_what_cannot_be_a_teacher_is_refused_at_the_door():
    nothing: Any = 3
    with pytest.raises(TypeError, match="function must be callable with an observation, got 3"):
        Teacher.from_callable(nothing, CARTPOLE)
    with pytest.raises(TypeError, match="action_values must be callable"):
        Teacher.from_callable(lambda o: 0, CARTPOLE, action_values=nothing)
    with pytest.raises(TypeError, match="action_probabilities must be callable"):
        Teacher.from_callable(lambda o: 0, CARTPOLE, action_probabilities=nothing)
    with pytest.raises(TypeError, match="a model needs a predict"):
        Teacher.from_model(object(), CARTPOLE)
    with pytest.raises(ValueError, match="not both"):
        Teacher.from_callable(lambda o: 0, CARTPOLE, lambda o: o[:2], action_probabilities=lambda o: o[:2])
    with pytest.raises(ValueError, match="of Pendulum-v1 are continuous"):
        Teacher.from_callable(lambda o: o[:1], PENDULUM, action_values=lambda o: o)


class Model:
    """What stable-baselines3's models look like from outside."""

    def __init__(self, observation_space: Any = None, action_space: Any = None) -> None:
        self.observation_space, self.action_space = observation_space, action_space

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ):
        assert deterministic
        assert observation.shape == X.shape
        return (observation[:, 2] > 0).astype(int), None


def test_anything_with_predict_is_a_teacher():
    teacher = Teacher.from_model(Model(), CARTPOLE)
    assert teacher.act(X).tolist() == [1, 0]
    assert teacher.action_values is None


@pytest.mark.parametrize(
    ("observation_space", "action_space", "what"),
    [
        (Box(-1, 1, (3,)), Discrete(2), r"observation space Box\(.*\(3,\).* does not fit that of CartPole-v1, Box"),
        (Discrete(4), Discrete(2), r"observation space Discrete\(4\)"),
        (Box(-1, 1, (4,)), Discrete(3), r"action space Discrete\(3\) does not fit .* Discrete\(2\)"),
        (Box(-1, 1, (4,)), Box(-1, 1, (1,)), "action space Box"),
    ],
)  # fmt: skip
def test_a_model_of_other_spaces_is_refused(observation_space: Any, action_space: Any, what: str):
    with pytest.raises(ValueError, match=what):
        Teacher.from_model(Model(observation_space, action_space), CARTPOLE)


def test_spaces_fit_part_by_part():
    other = Dict({**ODD.spaces, "box": Box(-2, 2, (2, 3), np.float64)})
    spec = chain(ODD, Box(-1, 1, (2,)))
    Teacher.from_model(Model(other, Box(-1, 1, (2,))), spec)
    with pytest.raises(ValueError, match="action space"):  # the same torque would be another
        Teacher.from_model(Model(ODD, Box(-2, 2, (2,))), spec)
    shorter = Dict({**ODD.spaces, "pair": Tuple((MultiBinary(2),))})
    with pytest.raises(ValueError, match="observation space"):
        Teacher.from_model(Model(shorter, Box(-1, 1, (2,))), spec)
