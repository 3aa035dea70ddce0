"""An environment that is given is the one that is played, and a run makes it again or says that it cannot."""

from __future__ import annotations

import dataclasses
import enum
from collections import defaultdict, deque
from pathlib import Path
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers

import sympol
from sympol.algorithms.presets import preset
from sympol.envs.entries import REGISTERED
from sympol.envs.equality import are_equal, step_limit
from sympol.envs.errors import EnvironmentFailure, UnknownEnvironment
from sympol.envs.registry import resolve
from sympol.envs.spec import OneCopy
from sympol.play import episode_seed
from sympol.runs.metadata import RunError
from sympol.trees import DecisionTree

pytestmark = [  # some are meant to be warned of
    pytest.mark.filterwarnings("ignore::sympol.envs.diagnostics.OwnStatistics"),
    pytest.mark.filterwarnings("ignore::sympol.envs.spec.OneCopy"),
]
TINY: dict[str, Any] = {"depth": 2, "num_steps": 16, "total_timesteps": 128, "num_evals": 1, "seed": 0}


def balancing() -> DecisionTree:
    """Push to where the pole falls: some 40 steps in CartPole."""
    cartpole = resolve("CartPole-v1")
    return DecisionTree.from_complete(
        np.array([2]),
        np.array([0.0]),
        np.array([[9.0, 0.0], [0.0, 9.0]]),
        actions=cartpole.actions,
        **cartpole.features.metadata(),
    )


class Extra(gymnasium.Wrapper):
    """Does not record its arguments, so that no spec can make it again."""


class Colour(enum.Enum):
    RED = 1


def without_motor() -> gymnasium.Env:
    env = gymnasium.make("CartPole-v1")
    env.unwrapped.force_mag = 0.0  # pyright: ignore[reportAttributeAccessIssue]
    return env


def with_statistics() -> gymnasium.Env:
    env = wrappers.NormalizeObservation(gymnasium.make("CartPole-v1"))
    env.reset(seed=0)
    return env


def used() -> gymnasium.Env:
    env = gymnasium.make("CartPole-v1")
    env.reset(seed=3)
    env.step(1)
    return env


def a_step_away() -> gymnasium.Env:
    env = gymnasium.make("FrozenLake-v1")
    env.unwrapped.P[0][1] = [(1.0, 15, 1.0, True)]  # pyright: ignore[reportAttributeAccessIssue]
    return env


def played_by_hand(env: gymnasium.Env, tree: DecisionTree, seed: int) -> float:
    observation, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(int(tree.predict(observation)))
        total, over = total + float(reward), terminated or truncated
    return total


@pytest.mark.parametrize("make", [without_motor, used, with_statistics], ids=lambda make: make.__name__)
def test_the_object_itself_is_evaluated(make):
    tree, by_hand = balancing(), make()
    returns, _ = sympol.evaluate_policy(tree, make(), 3, return_episode_rewards=True)
    assert returns == [played_by_hand(by_hand, tree, episode_seed(0, i)) for i in range(3)]


def test_what_a_wrapper_of_the_object_records_is_of_the_evaluation():
    env = wrappers.RecordEpisodeStatistics(gymnasium.make("CartPole-v1"))
    returns, _ = sympol.evaluate_policy(balancing(), env, 3, return_episode_rewards=True)
    assert list(env.return_queue) == returns


@pytest.mark.parametrize(
    "make", [without_motor, with_statistics, a_step_away], ids=lambda make: make.__name__
)
def test_an_object_that_was_changed_is_trained_on_itself_and_has_no_preset_of_its_id(make):
    env = make()
    agent = sympol.PPO("tree", env)
    assert agent.config.num_envs == 1
    assert agent.spec.preset_id == ""
    with pytest.raises(ValueError, match=r"num_envs must be 1, got 4: .* give a function that makes one"):
        agent.spec.host_envs(4)
    before = env.unwrapped.np_random
    agent.spec.host_envs(1).reset(seed=5)
    assert env.unwrapped.np_random is not before  # this very object was reset


@pytest.mark.parametrize(
    "make",
    [
        lambda: gymnasium.make("CartPole-v1"),
        used,
        lambda: gymnasium.make("CartPole-v1", render_mode="rgb_array"),
        lambda: gymnasium.make("LunarLander-v3"),
    ],
    ids=["new", "used", "drawing", "Box2D"],
)
def test_an_object_that_nothing_tells_from_its_id_has_its_preset_and_copies(make):
    spec = resolve(make())
    assert spec.preset_id == spec.name
    assert spec.host_envs(2).reset(seed=0).shape[0] == 2


def drawn() -> gymnasium.Env:
    env = gymnasium.make("CartPole-v1", render_mode="rgb_array")
    env.reset(seed=1)
    env.render()
    return env


def recorded() -> gymnasium.Env:
    env = wrappers.RecordEpisodeStatistics(gymnasium.make("CartPole-v1"))
    played_by_hand(env, balancing(), 1)
    return env


@pytest.mark.parametrize("make", [drawn, recorded], ids=lambda make: make.__name__)
def test_what_an_object_has_drawn_or_recorded_changes_nothing_in_it(make):
    assert resolve(make()).can_be_copied
    assert resolve(make()).origin.not_kept == ""


def test_an_object_that_is_trained_on_alone_is_warned_of():
    with pytest.warns(
        OneCopy, match=r"CartPole-v1 given is trained on alone .*give a function that makes it"
    ):
        sympol.PPO("tree", without_motor())


def test_a_function_that_returns_the_same_object_is_one_copy():
    env = gymnasium.make("CartPole-v1", max_episode_steps=30)
    tree = balancing()
    alone = sympol.evaluate_policy(tree, env, 4, return_episode_rewards=True)
    assert sympol.evaluate_policy(tree, lambda: env, 4, return_episode_rewards=True) == alone
    with pytest.raises(ValueError, match="returns the same object each time; let it make a new one"):
        resolve(lambda: env).host_envs(2)


def test_a_time_limit_counts_the_steps_of_the_wrapper_it_is_in():
    def make(limit_inside: bool) -> gymnasium.Env:
        env = gymnasium.make("MountainCar-v0", max_episode_steps=50 if limit_inside else -1)
        env = wrappers.RepeatAction(env, 4)
        return env if limit_inside else wrappers.TimeLimit(env, 50)

    assert are_equal(make(True), make(True))
    assert not are_equal(make(True), make(False))
    assert not resolve(make(False)).can_be_copied
    assert resolve(make(False)).origin.not_kept


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (deque(maxlen=8), deque(maxlen=3)),
        (defaultdict(int), defaultdict(list)),
        (type("Numbers", (list,), {})(), None),
    ],
    ids=["deque", "defaultdict", "subclass"],
)
def test_containers_are_compared_with_all_they_have(a, b):
    if b is None:
        b = type(a)()
        a.more = 1
    assert not are_equal(a, b)


@patch.dict(REGISTERED)
@pytest.mark.parametrize("how", ["registered", "limit", "ours"])
def test_an_id_that_means_another_environment_has_no_form_and_no_preset_of_ours(how, monkeypatch, tmp_path):
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    monkeypatch.setattr(gymnasium, "registry", gymnasium.envs.registration.registry)
    usual = gymnasium.registry["CartPole-v1"]
    if how == "registered":
        gymnasium.registry["CartPole-v1"] = gymnasium.envs.registration.EnvSpec("CartPole-v1", Recording)
    elif how == "limit":
        gymnasium.registry["CartPole-v1"] = dataclasses.replace(usual, max_episode_steps=17)
    else:
        sympol.register("CartPole-v1", Recording)
    spec = resolve("CartPole-v1")
    assert (spec.backend, spec.preset_id) == ("host", "")
    env = spec.make_host()  # pyright: ignore[reportOptionalCall]
    assert step_limit(env) == 17 if how == "limit" else isinstance(env.unwrapped, Recording)
    sympol.PPO("tree", "CartPole-v1", num_envs=1).save(tmp_path)
    with pytest.raises(RunError, match="CartPole-v1 had been registered anew"):
        sympol.load(tmp_path)


def test_naming_the_environment_of_a_run_again_means_it_with_its_arguments(tmp_path):
    sympol.PPO("tree", "CartPole-v1", env_kwargs={"max_episode_steps": 5}, num_envs=1).save(tmp_path)
    assert sympol.load(tmp_path, env="CartPole-v1").spec.max_episode_steps == 5
    host = sympol.PPO("tree", "CartPole-v1", backend="host", num_envs=2, **TINY)
    host.learn(progress_bar=False)
    host.save(tmp_path)
    assert sympol.load(tmp_path, env="CartPole-v1").tree() == host.tree()


def test_the_object_is_one_of_the_copies_and_stays_open():
    env = gymnasium.make("CartPole-v1", render_mode="rgb_array")
    envs = resolve(env).host_envs(3)
    envs.reset(seed=0)
    envs.close()
    assert env.unwrapped.np_random is not None
    env.reset()
    assert env.render() is not None
    assert env.unwrapped.isopen  # pyright: ignore[reportAttributeAccessIssue]


KEPT = {
    "arguments": (
        lambda: gymnasium.make("FrozenLake-v1", desc=["SFH", "FFG"], is_slippery=False),
        lambda env: env.unwrapped.desc.shape == (2, 3),
    ),
    "step limit": (
        lambda: gymnasium.make("CartPole-v1", max_episode_steps=50),
        lambda env: step_limit(env) == 50,
    ),
    "no step limit": (lambda: gymnasium.make("CartPole-v1").unwrapped, lambda env: step_limit(env) is None),
    "outer step limit": (
        lambda: wrappers.TimeLimit(gymnasium.make("CartPole-v1"), 30),
        lambda env: step_limit(env) == 30,
    ),
    "wrapper": (
        lambda: wrappers.RescaleAction(gymnasium.make("Pendulum-v1"), np.float32([-1]), np.float32([1])),
        lambda env: env.action_space.high == 1,
    ),
    "wrappers": (
        lambda: wrappers.FrameStackObservation(
            wrappers.RescaleObservation(gymnasium.make("MountainCar-v0"), np.float32(-1), np.float32(1)), 2
        ),
        lambda env: env.observation_space.shape == (2, 2) and env.observation_space.high.max() == 1,
    ),
    "number": (lambda: gymnasium.make("Pendulum-v1", g=5.0), lambda env: env.unwrapped.g == 5.0),
}


@pytest.mark.parametrize("given_as", ["object", "function"])
@pytest.mark.parametrize("kind", KEPT)
def test_what_an_environment_was_made_with_is_kept_in_its_run(kind, given_as, tmp_path):
    make, holds = KEPT[kind]
    env = make()
    agent = sympol.PPO("tree", env if given_as == "object" else make, num_envs=2)
    assert agent.spec.preset_id == ""
    agent.save(tmp_path)
    spec = sympol.load(tmp_path).spec
    assert spec.make_host is not None
    again = spec.make_host()
    assert holds(again)
    assert are_equal(make(), again)
    assert spec.max_episode_steps == step_limit(env)
    assert (spec.origin.not_kept, spec.preset_id) == ("", "")


LOST = {
    "changed": (without_motor, "changed afterwards"),
    "statistics": (with_statistics, "NormalizeObservation"),
    "new statistics": (lambda: wrappers.NormalizeReward(gymnasium.make("CartPole-v1")), "NormalizeReward"),
    "wrapper": (lambda: Extra(gymnasium.make("CartPole-v1")), "test_origin:Extra"),
    "function": (
        lambda: wrappers.TransformReward(gymnasium.make("CartPole-v1"), lambda reward: 2 * reward),
        "TransformReward",
    ),
    "film": (
        lambda: wrappers.TransformObservation(gymnasium.make("CartPole-v1"), lambda x: -x, None),
        "TransformObservation",
    ),
}


@pytest.mark.parametrize("given_as", ["object", "function"])
@pytest.mark.parametrize("kind", LOST)
def test_a_run_that_cannot_make_its_environment_again_says_why(kind, given_as, tmp_path):
    make, reason = LOST[kind]
    agent = sympol.PPO("tree", make() if given_as == "object" else make, num_envs=1, **TINY)
    agent.save(tmp_path)
    with pytest.raises(RunError, match=rf"CartPole-v1, .*{reason}.*give the environment itself"):
        sympol.load(tmp_path)
    env = make()
    assert sympol.load(tmp_path, env=env).spec.make_host() is env  # pyright: ignore[reportOptionalCall]


ARGUMENTS = {
    "None": None,
    "tuple": ("SF", "FG"),
    "nested": [("SF",), {"FG": None, "$type": 1}, {1: 2}],
    "set": {"SF", "FG"},
    "frozenset": frozenset({1, 2}),
    "path": Path("maps") / "small.txt",
    "bytes": b"\x00SF",
    "array": np.array([["S", "F"], ["F", "G"]]),
    "array of bytes": np.asarray(["SF", "FG"], dtype="S"),
    "array of numbers": np.float32([[np.nan, np.inf], [0.1, -0.0]]),
    "number": np.int64(3),
    "infinity": -np.inf,
}


class Recording(gymnasium.Env):
    """Keeps the argument it was made with."""

    observation_space = gymnasium.spaces.Box(-1, 1, (2,))
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, given: Any = "nothing", render_mode: str | None = None) -> None:
        self.given = given

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return np.zeros(2, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return np.zeros(2, np.float32), 0.0, True, False, {}


@pytest.fixture
def recording(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    monkeypatch.setattr(gymnasium, "registry", gymnasium.envs.registration.registry)
    gymnasium.register("Recording-v0", entry_point=Recording)
    return "Recording-v0"


@pytest.mark.parametrize("kind", ARGUMENTS)
@pytest.mark.parametrize("given_as", ["id", "object"])
def test_arguments_of_every_kind_come_back_as_they_were(kind, given_as, recording, tmp_path):
    value = ARGUMENTS[kind]
    if given_as == "id":
        agent = sympol.PPO("tree", recording, env_kwargs={"given": value}, num_envs=1)
    else:
        agent = sympol.PPO("tree", gymnasium.make(recording, given=value), num_envs=1)
    agent.save(tmp_path)
    again = sympol.load(tmp_path).spec.make_host().unwrapped.given  # pyright: ignore
    assert type(again) is type(value) or isinstance(value, Path)
    assert are_equal(again, value)


@pytest.mark.parametrize(
    "value",
    [Colour.RED, print, object(), [{"a": Colour.RED}]],
    ids=["enum", "function", "object", "deep inside"],
)
def test_an_argument_that_cannot_be_kept_is_named_when_the_run_is_loaded(value, recording, tmp_path):
    agent = sympol.PPO("tree", recording, env_kwargs={"given": value}, num_envs=1)
    agent.save(tmp_path)
    with pytest.raises(RunError, match=r"env_kwargs\['given'\].* is of type .*give the environment itself"):
        sympol.load(tmp_path)
    sympol.load(tmp_path, env=lambda: Recording(value))


def test_no_preset_of_an_id_for_what_was_made_with_arguments():
    usual, changed = (sympol.PPO("tree", "Pendulum-v1", env_kwargs=kwargs) for kwargs in (None, {"g": 5.0}))
    assert usual.config != changed.config
    assert {key: getattr(changed.config, key) for key in preset("")} == preset("")


def test_equality_sees_through_circles_wrappers_and_addresses():
    class Pair:
        def __init__(self, number):
            self.number, self.other = number, self

    assert are_equal(Pair(1), Pair(1))
    assert not are_equal(Pair(1), Pair(2))
    assert not are_equal([object()], [print])
    landers = [gymnasium.make("LunarLander-v3") for _ in range(2)]
    assert are_equal(*landers)
    landers[0].unwrapped.world.gravity = (0, -3)  # pyright: ignore[reportAttributeAccessIssue]
    assert not are_equal(*landers)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("import package_that_is_not_there", ImportError, "was found, but needs package_that_is_not_there"),
        ("raise RuntimeError('no licence')", ImportError, "importing it failed: RuntimeError: no licence"),
        ("raise SystemExit(3)", ImportError, "importing it failed: SystemExit: 3"),
        ("def", ImportError, "importing it failed: SyntaxError"),
        (None, UnknownEnvironment, "there is no module tank_of_mine; is its folder on PYTHONPATH?"),
    ],
)
def test_a_module_that_cannot_be_imported(text, error, message, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    if text is not None:
        (tmp_path / "tank_of_mine.py").write_text(text)
    with pytest.raises(error, match=message):
        resolve("tank_of_mine:Tank-v0")


def test_an_environment_that_cannot_be_made_says_so_in_one_line():
    with pytest.raises(
        EnvironmentFailure, match=r"LunarLander-v3 cannot be made with gravity=5: AssertionError: gravity"
    ):
        resolve("LunarLander-v3", env_kwargs={"gravity": 5})
