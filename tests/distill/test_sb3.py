"""Models of stable-baselines3: what is refused without it, and the real thing where it is installed."""

from __future__ import annotations

import builtins
import json
import pickle
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, MultiDiscrete

from sympol.distill import Teacher, load_sb3, viper
from sympol.play import play

from ..tiny import Chain
from .teachers import CARTPOLE, PENDULUM, chain, resolve


def archive(path: Path, content: Any, module: str = "stable_baselines3.common.policies") -> Path:
    """A file as stable-baselines3 writes it, as far as it can be read without unpickling."""
    with zipfile.ZipFile(path, "w") as file:
        data = {"policy_class": {"__module__": module}, **dict.fromkeys(content, 1)}
        file.writestr("data", json.dumps(data))
    return path


def test_without_trust_nothing_is_unpickled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = archive(tmp_path / "expert.zip", ["clip_range"])
    monkeypatch.setattr(pickle, "loads", lambda *_: pytest.fail("unpickled"))
    imported = builtins.__import__
    monkeypatch.setattr(
        builtins,
        "__import__",
        lambda name, *rest, **more: pytest.fail(name) if "stable" in name else imported(name, *rest, **more),
    )
    for name in (path, path.with_suffix("")):  # stable-baselines3 adds the ending, too
        with pytest.raises(ValueError, match=r"expert\.zip holds pickled objects, .* any code .* --trust"):
            load_sb3(name, CARTPOLE)


def test_what_is_no_model_is_refused_by_name(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"no file .*nowhere\.zip"):
        load_sb3(tmp_path / "nowhere.zip", CARTPOLE, trust=True)
    (tmp_path / "text.zip").write_text("no zip")
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as file:
        file.writestr("readme", "hello")
    with zipfile.ZipFile(tmp_path / "list.zip", "w") as file:
        file.writestr("data", "[]")
    for name in ("text", "other", "list"):
        with pytest.raises(ValueError, match=rf"{name}\.zip is not a model of stable-baselines3"):
            load_sb3(tmp_path / f"{name}.zip", CARTPOLE)
    archive(tmp_path / "contrib.zip", ["clip_range"], "sb3_contrib.common.recurrent.policies")
    archive(tmp_path / "own.zip", ["gamma"])
    for name in ("contrib", "own"):
        with pytest.raises(ValueError, match=r"must be a model of PPO, .* Teacher\.from_model"):
            load_sb3(tmp_path / f"{name}.zip", CARTPOLE, trust=True)


def test_without_the_package_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ImportError, match=r"pip install 'sympol\[sb3\]'"):
        load_sb3(archive(tmp_path / "a.zip", ["clip_range"]), CARTPOLE, trust=True)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("PPO", ["gae_lambda", "clip_range"]),
        ("A2C", ["gae_lambda"]),
        ("DQN", ["exploration_fraction"]),
        ("SAC", ["target_entropy"]),
        ("TD3", ["policy_delay"]),
    ],
)
def test_the_algorithm_is_found_by_what_its_file_holds(
    name: str, content: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def load(path: Path, device: str) -> Any:
        return SimpleNamespace(predict=lambda x, deterministic: (np.ones(len(x), int), None))

    package = SimpleNamespace(__version__="0", **{name: SimpleNamespace(load=load)})
    monkeypatch.setitem(sys.modules, "stable_baselines3", package)  # pyright: ignore
    teacher = load_sb3(archive(tmp_path / "a.zip", content), CARTPOLE, trust=True)
    assert teacher.act(np.zeros((3, 4), np.float32)).tolist() == [1, 1, 1]
    assert teacher.action_values is None
    package = SimpleNamespace(__version__="0", **{name: SimpleNamespace(load=lambda *_, **__: 1 / 0)})
    monkeypatch.setitem(sys.modules, "stable_baselines3", package)  # pyright: ignore
    with pytest.raises(ValueError, match=rf"looks like a {name} model, but .* cannot load it: division"):
        load_sb3(tmp_path / "a.zip", CARTPOLE, trust=True)


# ---- the real thing: `pip install 'sympol[sb3]'` ----


@pytest.fixture
def sb3(recwarn: pytest.WarningsRecorder) -> Any:
    package = pytest.importorskip("stable_baselines3")
    sys.modules["torch"].set_num_threads(1)  # its threads wait for each other where cores are shared
    return package


REAL = [
    ("PPO", "CartPole-v1"), ("A2C", "CartPole-v1"), ("DQN", "CartPole-v1"), ("PPO", "Pendulum-v1"),
    ("SAC", "Pendulum-v1"), ("TD3", "Pendulum-v1"), ("DDPG", "Pendulum-v1"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "env"), REAL)
def test_a_saved_model_acts_as_it_did(sb3: Any, name: str, env: str, tmp_path: Path):
    spec = {"CartPole-v1": CARTPOLE, "Pendulum-v1": PENDULUM}[env]
    model = getattr(sb3, name)("MlpPolicy", env, seed=0, device="cpu")
    model.save(tmp_path / "model")
    teacher = load_sb3(tmp_path / "model", spec, trust=True)
    x = np.random.default_rng(0).normal(size=(300, len(spec.features.names))).astype(np.float32)
    expected = model.predict(x, deterministic=True)[0]
    np.testing.assert_array_equal(teacher.act(x), expected)
    if spec is PENDULUM:
        assert teacher.action_values is None
    else:
        assert teacher.action_values is not None
        values = teacher.action_values(x)
        np.testing.assert_array_equal(values.argmax(axis=1), expected)
        if name != "DQN":
            np.testing.assert_allclose(np.exp(values).sum(axis=1), 1, rtol=1e-5)
    with pytest.raises(ValueError, match=r"space .* does not fit that of"):
        load_sb3(tmp_path / "model", PENDULUM if spec is CARTPOLE else CARTPOLE, trust=True)


def test_components_and_dicts_of_observations_are_understood(sb3: Any):
    seen, taken = Dict({"a": Box(-1, 1, (2,)), "b": Box(-1, 1, (1, 2))}), MultiDiscrete([2, 3])
    model = sb3.PPO("MultiInputPolicy", Chain(seen, taken), n_steps=8, batch_size=8, device="cpu")
    teacher = Teacher.from_model(model, chain(seen, taken))
    x = np.random.default_rng(0).uniform(-1, 1, (50, 4)).astype(np.float32)
    assert teacher.action_values is not None
    values = teacher.action_values(x)
    chosen = np.stack([values[:, :2].argmax(axis=1), values[:, 2:].argmax(axis=1)], axis=1)
    np.testing.assert_array_equal(teacher.act(x), chosen)


def test_a_trained_model_becomes_a_tree(sb3: Any, tmp_path: Path):
    model = sb3.PPO("MlpPolicy", "CartPole-v1", n_steps=256, learning_rate=1e-3, seed=0, device="cpu")
    model.learn(15_000).save(tmp_path / "expert.zip")
    spec = resolve("CartPole-v1", backend="host")
    teacher = load_sb3(tmp_path / "expert.zip", spec, trust=True)
    tree = viper(teacher, depth=5, num_iterations=6, num_validation_episodes=10)
    its, ours = (play(policy, spec, 20, seed=0).returns.mean() for policy in (teacher, tree))
    assert its > 200
    assert ours > 0.8 * its
