from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    Graph,
    MultiBinary,
    MultiDiscrete,
    OneOf,
    Sequence,
    Text,
    Tuple,
)

from sympol.envs.spaces import Features, action_spec, native_actions
from sympol.trees.actions import BoxActions, DiscreteActions, MultiDiscreteActions

SPACES = [
    Box(-1, 1, (3,)),
    Box(-1, 1, ()),
    Box(0, 255, (2, 3, 1), np.uint8),
    Box(np.array([-np.inf, 0]), np.array([1e30, 0.1]), dtype=np.float64),
    Box(-(2**40), 2**40, (2,), np.int64),
    Discrete(4),
    Discrete(3, start=-1),
    MultiBinary(3),
    MultiBinary((2, 2)),
    MultiDiscrete([3, 2]),
    MultiDiscrete(np.array([[2, 3], [4, 1]]), start=np.array([[1, -2], [0, 7]])),
    Dict({"position": Box(-1, 1, (2,)), "gear": Discrete(3)}),
    Tuple((Discrete(2), Box(0, 255, (2, 2), np.uint8), MultiBinary(2))),
    Dict(
        {
            "b": Dict({"c": Discrete(2), "d": Tuple((Box(0, 1, (1,)), MultiDiscrete([2, 2])))}),
            "a": MultiBinary(1),
        }
    ),
]
each_space = pytest.mark.parametrize("space", SPACES, ids=str)


@each_space
def test_many_at_once_are_each(space: Any) -> None:
    features = Features.of(space)
    space.seed(1)
    samples = [space.sample() for _ in range(7)]
    np.testing.assert_array_equal(
        features.flatten_each(samples), [features.flatten(sample) for sample in samples]
    )


def test_one_bad_observation_among_many_is_named() -> None:
    features = Features.of(Box(-1, 1, (3,)))
    with pytest.raises(ValueError, match="observation"):
        features.flatten_each([np.zeros(3), np.zeros(2)])


@each_space
def test_flatten_is_gymnasiums(space: Any) -> None:
    features = Features.of(space)
    space.seed(0)
    samples = [space.sample() for _ in range(50)]
    expected = np.array([gymnasium.spaces.flatten(space, sample) for sample in samples]).astype(np.float32)
    rows = np.array([features.flatten(sample) for sample in samples])
    assert rows.dtype == np.float32
    np.testing.assert_array_equal(rows, expected)
    assert (rows >= features.low).all()
    assert (rows <= features.high).all()

    batched = gymnasium.vector.utils.batch_space(space, len(samples))
    batch = gymnasium.vector.utils.concatenate(
        space, samples, gymnasium.vector.utils.create_empty_array(space, n=len(samples))
    )
    assert batched.contains(batch)
    np.testing.assert_array_equal(features.flatten(batch), expected)


@each_space
def test_every_feature_has_its_own_name_and_bounds(space: Any) -> None:
    features = Features.of(space)
    size = gymnasium.spaces.flatdim(space)
    assert len(set(features.names)) == size
    assert features.low.shape == features.high.shape == (size,)
    assert features.low.dtype == features.high.dtype == np.float32


def test_absurd_bounds_are_none() -> None:
    space = Box(np.float32([0, -2e6, -np.inf, 1, 0]), np.float32([1, 5, 1e6, 2, 999_999]))
    space.low[3], space.high[0] = 5, np.nan  # gymnasium refuses to make these, but not to keep them
    features = Features.of(space)
    assert features.low.tolist() == [0, -np.inf, -np.inf, -np.inf, 0]
    assert features.high.tolist() == [np.inf, 5, np.inf, np.inf, 999_999]


def test_names_say_where_a_feature_comes_from() -> None:
    assert Features.of(Box(0, 1, (2,))).names == ("x[0]", "x[1]")
    assert Features.of(Box(0, 1, (1, 2))).names == ("x[0, 0]", "x[0, 1]")
    assert Features.of(Box(0, 1, ())).names == ("x",)
    assert Features.of(Discrete(2, start=5)).names == ("x = 5", "x = 6")
    assert Features.of(MultiDiscrete([2, 1])).names == ("x[0] = 0", "x[0] = 1", "x[1] = 0")
    nested = Dict(
        {"camera": Dict({"x": Box(0, 1, (2,))}), "weather": Discrete(2), "pair": Tuple((Box(0, 1, ()),))}
    )
    assert Features.of(nested).names == ("camera.x[0]", "camera.x[1]", "pair.0", "weather = 0", "weather = 1")
    assert Features.of(Dict({"x": Dict({"a": Discrete(1)}), "a": Discrete(1)})).names == ("a = 0", "x.a = 0")
    assert Features.of(Tuple((Discrete(1), MultiBinary(1)))).names == ("x.0 = 0", "x.1[0]")


def test_the_users_names_are_kept_as_they_are() -> None:
    names = ['"quoted"\n', "'); import os"]
    assert Features.of(Box(0, 1, (2,)), names).names == tuple(names)


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["one"], "must have 2 names, got 1; the defaults are 'x[0]', 'x[1]'"),
        ("ab", "must be a sequence of strings, got 'ab'"),
        (["a", 1], "must be a sequence of strings"),
        (["a", "a"], "got ['a'] more than once"),
    ],
)
def test_names_that_do_not_fit(names: Any, says: str) -> None:
    with pytest.raises(ValueError, match="feature_names") as error:
        Features.of(Box(0, 1, (2,)), names)
    assert says in str(error.value)


def test_what_float32_cannot_hold() -> None:
    features = Features.of(Box(-np.inf, np.inf, (4,), np.float64))
    flat = features.flatten(np.array([1e300, 1e-40, -1e-300, 1 / 3]))
    np.testing.assert_array_equal(flat, np.array([np.inf, 0, 0, np.float32(1 / 3)], np.float32))


def test_flatten_returns_an_array_of_its_own() -> None:
    observation = np.zeros(2, np.float32)
    flat = Features.of(Box(0, 1, (2,))).flatten(observation)
    observation[:] = 1
    assert (flat == 0).all()


NESTED = Dict({"position": Box(-1, 1, (2,)), "gear": Discrete(3)})


@pytest.mark.parametrize(
    ("space", "observation", "says"),
    [
        (Box(0, 1, (3,)), np.zeros(2), "observation must be an array of real numbers of shape (3,)"),
        (Box(0, 1, (3,)), np.zeros(2), "got float64 array of shape (2,)"),
        (Box(0, 1, (3,)), 0.5, "got float 0.5"),
        (Box(0, 1, (2,)), np.zeros(2, complex), "real numbers"),
        (Box(0, 1, (2,)), ["a", "b"], "got list ['a', 'b']"),
        (Box(0, 1, (2,)), [[1.0], [2.0, 3.0]], "got list"),
        (Box(0, 1, (2,)), None, "got NoneType None"),
        (Discrete(3), 3, "must be a category from 0 to 2, got 3"),
        (Discrete(3), -1, "must be a category from 0 to 2, got -1"),
        (Discrete(3), 1.0, "array of integers of shape ()"),
        (
            MultiDiscrete([2, 3], start=[0, 1]),
            np.array([0, 0]),
            "observation[1] must be a category from 1 to 3",
        ),
        (MultiBinary(2), np.array([0.5, 1.0]), "integers"),
        (MultiBinary(2), "01", "integers"),
        (Box(0, 1, ()), None, "real numbers"),
        (Box(0, 1, (2,)), [None, 0.5], "real numbers"),
        (Dict({1: Discrete(2), "a": Discrete(2)}), {2: 0, "b": 1}, "with the keys [1, 'a'], got [2, 'b']"),
        (NESTED, np.zeros(2), "must be a dict with the keys ['gear', 'position'], got float64 array"),
        (NESTED, {"gear": 1}, "must be a dict with the keys ['gear', 'position'], got ['gear']"),
        (NESTED, {"gear": 1, "position": np.zeros(3)}, "observation['position'] must be"),
        (
            NESTED,
            {"gear": np.array([1, 2]), "position": np.zeros(2)},
            "same leading batch axes, got (2,) and ()",
        ),
        (Tuple((Discrete(2),)), [1, 0], "must be a tuple of 1 parts, got list [1, 0]"),
        (Tuple((Discrete(2),)), np.array(1), "must be a tuple of 1 parts, got int64 array"),
        (
            Tuple((Discrete(2), Discrete(2))),
            [(0, 1), (1, 1)],
            "must be a tuple of 2 parts where it is a batch",
        ),
        (Tuple((Discrete(2), Discrete(2))), np.zeros((2, 2), int), "tuple of 2 parts where it is a batch"),
    ],
)
def test_an_observation_that_does_not_fit(space: Any, observation: Any, says: str) -> None:
    features = Features.of(space)
    with pytest.raises(ValueError, match="observation") as error:
        features.flatten(observation)
    assert says in str(error.value)


SEVERAL_FORMS = [
    (Discrete(2), [True, 1, np.int8(1), np.uint8(1), np.array(1)], 1),
    (Discrete(3, start=-1), [True, np.array(1, np.int16)], 1),
    (MultiBinary(2), [[0.0, 1.0], (0, 1), [False, True], np.array([0.0, 1.0]), np.array([0, 1], object)], [0, 1]),
    (MultiBinary((1, 2)), [[[0, 1]], np.array([[0.0, 1.0]], np.float16)], [[0, 1]]),
    (MultiDiscrete([2, 2]), [[True, False], (1, 0), np.array([1, 0], np.int8), np.array([True, False])], [1, 0]),
    (Box(0, 2, ()), [1, True, 1.0, Fraction(1), Decimal(1), "1", np.float32(1), np.float16(1)], 1.0),
    (Box(0, 2, (2,)), [[1, 0], (1, False), [Decimal(1), Fraction(0)], np.array([1, 0], np.uint8)], [1.0, 0.0]),
    (Box(0, 1e24, (1,), np.float64), [[2**70], [float(2**70)]], [2.0**70]),
    (Box(0, 9, (2,), np.int32), [[1.0, 2.0], np.array([1, 2], np.int8), [np.int64(1), 2]], np.array([1, 2])),
    (Tuple((Discrete(2), Discrete(3))), [[True, 2], np.array([1, 2])], (1, 2)),
    (Tuple((Box(-1, 1, (2,)), Box(-1, 1, (2,)))), [[[1, 0], (0, 1)], np.eye(2, dtype=np.float32)], ([1, 0], [0, 1])),
    (Dict({"a": MultiBinary(2), "b": Tuple((Discrete(2),))}), [{"b": [1], "a": [0.0, 1.0]}], {"a": [0, 1], "b": (1,)}),
]  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*Casting input x to numpy array")
@pytest.mark.parametrize(("space", "forms", "plain"), SEVERAL_FORMS, ids=[str(s) for s, *_ in SEVERAL_FORMS])
def test_what_a_space_contains_can_be_flattened(space: Any, forms: Any, plain: Any) -> None:
    features = Features.of(space)
    for form in forms:
        assert space.contains(form)
        np.testing.assert_array_equal(features.flatten(form), features.flatten(plain))
        np.testing.assert_array_equal(
            features.flatten_each([form, plain]), features.flatten_each([plain] * 2)
        )


@each_space
def test_an_empty_batch_has_no_rows(space: Any) -> None:
    features = Features.of(space)
    empty = gymnasium.vector.utils.create_empty_array(space, n=0)
    nothing = np.zeros((0, len(features.names)), np.float32)
    given = [empty] if isinstance(space, Dict | Tuple) else [empty, empty.astype(np.float64), []]
    for batch in given:
        flat = features.flatten(batch)
        assert flat.dtype == np.float32
        np.testing.assert_array_equal(flat, nothing)
    np.testing.assert_array_equal(features.flatten_each([]), nothing)


@pytest.mark.parametrize(
    ("space", "names", "num_groups"),
    [
        (
            Dict({"arm.joint": Discrete(2), "arm": Dict({"joint": Discrete(1)}), "leg": Box(0, 1, (1,))}),
            ["['arm']['joint'] = 0", "['arm.joint'] = 0", "['arm.joint'] = 1", "leg[0]"],
            2,
        ),
        (Dict({1: Discrete(1), "1": Discrete(1)}), ["[1] = 0", "['1'] = 0"], 2),
        (Dict({"a": Tuple((Discrete(1),)), "a.0": Discrete(1)}), ["['a'][0] = 0", "['a.0'] = 0"], 2),
        (Dict({"a": Box(0, 1, (1,)), "a[0]": Box(0, 1, ())}), ["['a'][0]", "['a[0]']"], 0),
        (Dict({"a": Discrete(1), "a = 0": Box(0, 1, ())}), ["['a'] = 0", "['a = 0']"], 1),
        (
            Dict({"['a']": Discrete(1), "a": Discrete(1), "a = 0": Box(0, 1, ())}),
            ["[\"['a']\"] = 0", "['a'] = 0", "['a = 0']"],
            2,
        ),
        (
            Tuple((Dict({"a": Dict({"b": Discrete(1)}), "a.b": Discrete(1)}), Discrete(1))),
            ["x[0]['a']['b'] = 0", "x[0]['a.b'] = 0", "x.1 = 0"],
            3,
        ),
    ],
    ids=str,
)
def test_keys_that_spell_one_path_are_two_choices(space: Any, names: list[str], num_groups: int) -> None:
    features = Features.of(space)
    assert sorted(features.names) == sorted(names)
    assert len(features.groups) == num_groups
    space.seed(0)
    for _ in range(5):
        sample = space.sample()
        np.testing.assert_array_equal(features.flatten(sample), gymnasium.spaces.flatten(space, sample))


@pytest.mark.parametrize(
    "space",
    [
        Text(3),
        Sequence(Discrete(2)),
        Graph(Box(0, 1, (1,)), None),
        OneOf((Discrete(2), Discrete(3))),
        Dict({"a": Box(0, 1), "b": Text(3)}),
    ],
    ids=lambda space: type(space).__name__,
)
def test_unsupported_observation_spaces(space: Any) -> None:
    with pytest.raises(ValueError, match=r"unsupported observation space .* supported are Box, Discrete"):
        Features.of(space)


def test_an_observation_without_features() -> None:
    with pytest.raises(ValueError, match="at least one feature"):
        Features.of(Dict({}))


def test_action_specs() -> None:
    assert action_spec(Discrete(2, start=3), ["left", "right"]) == DiscreteActions(2, ("left", "right"), 3)
    multi = MultiDiscrete([2, 3], start=[1, 0])
    assert action_spec(multi, ["gas", "gear"]) == MultiDiscreteActions((2, 3), ("gas", "gear"), start=(1, 0))
    box = Box(np.array([[-1, -np.inf]]), np.array([[0.1, 2]]), dtype=np.float64)
    names = ("a", "b")
    assert action_spec(box, names) == BoxActions((-1, -np.inf), (np.float32(0.1), 2), (1, 2), names)
    assert action_spec(Discrete(2)).names == ("action 0", "action 1")


@pytest.mark.parametrize(
    "space",
    [
        MultiBinary(2),
        Text(2),
        Dict({"a": Discrete(2)}),
        MultiDiscrete([[2, 2]]),
        Box(0, 3, (2,), np.int32),
        Box(0, 1, (0,)),
    ],
    ids=str,
)
def test_unsupported_action_spaces(space: Any) -> None:
    with pytest.raises(ValueError, match=r"unsupported action space .* supported are Discrete"):
        action_spec(space)


def test_action_names_that_do_not_fit() -> None:
    with pytest.raises(ValueError, match="action_names must have 2 names, got 1"):
        action_spec(Discrete(2), ["left"])


def test_native_actions_belong_to_the_space() -> None:
    discrete = Discrete(3, start=-1)
    assert native_actions(discrete, np.array([0, 2], np.int32)).tolist() == [-1, 1]
    multi = MultiDiscrete([2, 3], start=[1, 5])
    assert native_actions(multi, np.array([[0, 0], [1, 2]], np.int32)).tolist() == [[1, 5], [2, 7]]
    # float32(0.1) is more than 0.1
    box = Box(-0.1, 0.1, (2, 1), np.float64)
    flat = np.full((3, 2), 0.1, np.float32)
    for actions in (flat, flat.reshape(3, 2, 1)):
        native = native_actions(box, actions)
        assert all(box.contains(action) for action in native)
