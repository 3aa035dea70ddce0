"""Observations of every space; for `studies.benchmarks.fuzz`."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box as BoxSpace
from gymnasium.spaces import Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from tests.tiny import Chain

import sympol
from sympol.trees import DecisionTree

from .fuzz_ask import Broken
from .fuzz_commands import Box


class Observations:
    """Observations for agents and trees of every space: (number of the world, call, observation)."""

    def __init__(self, scratch: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.agents = [_acting(*world) for world in _worlds()]
            self.mlp = sympol.load(Box(scratch).made / "mlp")
        self.agents.append(self.mlp)

    def make(self, dice: Random) -> tuple[int, str, Any]:
        """Draw an observation that the space has, and change a part of it."""
        which = dice.randrange(len(self.agents))
        space = self.agents[which].spec.observation_space
        space.seed(dice.getrandbits(31))
        call = dice.choice(("agent",) * 6 + ("sampled", "tree", "apply", "proba", "flat"))
        observation = space.sample()
        if dice.random() < 0.3:
            batch = [space.sample() for _ in range(dice.choice((0, 1, 2, 3)))]
            observation = _stacked(observation, batch)
        if call in ("tree", "apply", "proba", "flat"):
            with contextlib.suppress(ValueError):
                observation = self.agents[which].spec.features.flatten(observation)
        if dice.random() < 0.85:
            observation = _changed_part(dice, observation)
        return which, call, observation

    def ask(self, given: tuple[int, str, Any]) -> bool:
        """Act on it."""
        which, call, observation = given
        agent = self.agents[which]
        allowed = (ValueError, TypeError) if call in ("tree", "apply", "proba") else (ValueError,)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            try:
                if call in ("agent", "sampled", "flat"):
                    space = agent.spec.observation_space
                    valid = call == "agent" and _contains(space, observation)
                    try:
                        action, _ = agent.predict(observation, deterministic=call != "sampled")
                    except ValueError as error:
                        if valid:
                            kind = f"{type(space).__name__} contains {type(observation).__name__}, which is refused"
                            raise Broken(kind, str(error)) from error
                        raise
                    if valid and not agent.spec.action_space.contains(action):
                        raise Broken("an action that the space has not", repr(action))
                elif agent.has_tree:
                    tree = agent.tree()
                    {"tree": tree.predict, "apply": tree.apply, "proba": tree.predict_proba}[call](
                        observation
                    )
            except allowed:
                return False
        return True


def _worlds() -> list[tuple[gymnasium.Space, gymnasium.Space]]:
    observed = [
        BoxSpace(-1, 1, (3,)),
        BoxSpace(-np.inf, np.inf, (2, 2), np.float64),
        BoxSpace(0, 255, (2, 2, 1), np.uint8),
        BoxSpace(-5, 5, (2,), np.int32),
        BoxSpace(-1, 1, (), np.float32),
        BoxSpace(-1, 1, (1,), np.float16),
        Discrete(4),
        Discrete(3, start=-1),
        MultiDiscrete([2, 3]),
        MultiDiscrete(np.array([[2, 3], [2, 2]])),
        MultiBinary(3),
        MultiBinary((2, 2)),
        Dict({"a": BoxSpace(-1, 1, (2,)), "b": Discrete(3), "c": MultiBinary(2)}),
        Dict(
            {
                "x": Dict({"y": BoxSpace(0, 1, (1,)), "z": Discrete(2)}),
                "w": Tuple([Discrete(2), MultiBinary(1)]),
            }
        ),
        Tuple([BoxSpace(-1, 1, (2,)), Discrete(2), Dict({"k": MultiDiscrete([2, 2])})]),
    ]
    acted = [
        *(Discrete(3), Discrete(2, start=1), MultiDiscrete([2, 3]), BoxSpace(-1, 1, (2,))),
        *(BoxSpace(-2, 2, (1, 2), np.float64), BoxSpace(-np.inf, np.inf, (1,))),
    ]
    return [(space, acted[i % len(acted)]) for i, space in enumerate(observed)]


def _acting(observed: gymnasium.Space, acted: gymnasium.Space) -> Any:
    """An agent that acts by a tree, and has not learnt."""
    env = Chain(observed, acted)
    spec = sympol.resolve(env)
    n, rng = len(spec.features.names), np.random.default_rng(0)
    tree = DecisionTree.from_complete(
        rng.integers(n, size=3),
        np.full(3, 0.5, np.float32),
        rng.normal(size=(4, spec.actions.n_outputs)),
        actions=spec.actions,
        **spec.features.metadata(),
    )
    return sympol.PPO("tree", env, start=tree, depth=2)


def _contains(space: gymnasium.Space, observation: Any) -> bool:
    try:
        return bool(space.contains(observation))
    except Exception:
        return False


def _stacked(like: Any, batch: list[Any]) -> Any:
    """Samples with a leading axis on every array, as in Gymnasium's vector environments."""
    if isinstance(like, dict):
        return {key: _stacked(part, [one[key] for one in batch]) for key, part in like.items()}
    if isinstance(like, tuple):
        return tuple(_stacked(part, [one[i] for one in batch]) for i, part in enumerate(like))
    array = np.asarray(like)
    return np.array(batch, array.dtype).reshape(len(batch), *array.shape)


def _changed_part(dice: Random, observation: Any) -> Any:
    if isinstance(observation, dict) and dice.random() < 0.8:
        changed = dict(observation)
        key = dice.choice([*changed])
        match dice.randrange(6):
            case 0:
                changed.pop(key)
            case 1:
                changed[dice.choice(("new", 1, None, ("a",), "a.b"))] = 0
            case 2:
                changed[dice.choice((1, f"{key} ", key.upper()))] = changed.pop(key)
            case _:
                changed[key] = _changed_part(dice, changed[key])
        return changed
    if isinstance(observation, tuple) and dice.random() < 0.8:
        parts = [*observation]
        at = dice.randrange(len(parts))
        match dice.randrange(5):
            case 0:
                return parts
            case 1:
                parts.pop(at)
            case 2:
                parts.append(parts[at])
            case _:
                parts[at] = _changed_part(dice, parts[at])
        return tuple(parts)
    if isinstance(observation, dict | tuple) or dice.random() < 0.25:
        return dice.choice(_ODD)()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return dice.choice(_ARRAY_CHANGES)(dice, np.asarray(observation))


def _looped() -> list[Any]:
    loop: list[Any] = []
    loop.append(loop)
    return loop


_ODD: tuple[Callable[[], Any], ...] = (
    *(lambda: None, lambda: True, lambda: 0, lambda: 1.5, lambda: "x", lambda: b"x", lambda: "", lambda: []),
    *(lambda: {}, lambda: (), lambda: set(), lambda: object(), lambda: 10**400, lambda: -1, lambda: 2**63),
    *(lambda: float("nan"), lambda: float("inf"), lambda: 1j, lambda: [[1, 2], [3]], lambda: [None, 1]),
    *(
        lambda: iter([1, 2]),
        lambda: range(3),
        lambda: np.float64,
        lambda: np.array("x"),
        lambda: np.array(None),
    ),
    *(lambda: np.datetime64("2020-01-01"), lambda: np.zeros((0, 3)), lambda: np.zeros((3, 0)), _looped),
    *(lambda: np.zeros(3, "f4,i4"), lambda: np.bool_(True), lambda: np.int64(1), lambda: np.zeros((1,) * 32)),
    *(
        lambda: np.uint64(2**64 - 1),
        lambda: [10**400] * 3,
        lambda: ["a", 1.0],
        lambda: {"a": {}},
        lambda: [{}],
    ),
)
"""Each makes what is no observation of most spaces."""

_DTYPES = (
    "f2",
    "f4",
    "f8",
    "g",
    "c8",
    "?",
    "u1",
    "i1",
    "i2",
    "i4",
    "i8",
    "u8",
    "O",
    "U8",
    "S8",
    "M8[s]",
    ">f4",
    ">i8",
)
_ARRAY_CHANGES: tuple[Callable[[Random, np.ndarray], Any], ...] = (
    lambda dice, x: x.astype(dice.choice(_DTYPES)),
    lambda dice, x: x.astype(dice.choice(_DTYPES)),
    lambda dice, x: x.tolist(),
    lambda dice, x: [*x] if x.ndim else [x],
    lambda dice, x: x[None],
    lambda dice, x: x[..., None],
    lambda dice, x: np.array([x] * dice.choice((0, 1, 2, 5))),
    lambda dice, x: np.resize(
        x, dice.choice(((), (0,), (1,), (2,), (3,), (4,), (2, 2), (0, 3), (5, 3), (2, 3, 4)))
    ),
    lambda dice, x: x.ravel(),
    lambda dice, x: x.T,
    lambda dice, x: np.full_like(x, dice.choice((0, 1, 2, 7)), dtype=dice.choice(("f4", "i8", "f8"))),
    lambda dice, x: np.full(x.shape, dice.choice((np.nan, np.inf, -np.inf, 1e300, -1e39, 1e-45, -0.0, 1e19))),
    lambda dice, x: np.full(x.shape, dice.choice((-1, 2**31, 2**53, 2**63 - 1, -(2**63))), "i8"),
    lambda dice, x: np.full(x.shape, 2**64 - 1, "u8"),
    lambda dice, x: x.astype("f8") * dice.choice((-1, 1e30, 1e300, 0.3)),
    lambda dice, x: np.ma.masked_array(x, mask=np.ones(x.shape, bool)),
    lambda dice, x: np.asfortranarray(x)[::-1] if x.ndim else x,
    lambda dice, x: tuple(x.ravel().tolist()),
    lambda dice, x: {"x": x},
    lambda dice, x: np.array([x, None], object)[:1],
    lambda dice, x: x.item() if x.size == 1 else x.tolist(),
)
