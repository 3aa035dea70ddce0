"""The tree that is read is the policy that was trained.

On a million observations of each kind of action, and on all that there are in MiniGrid's small tasks.
"""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from studies.benchmarks import no_loss, timing

import sympol
from sympol.play import play
from tests.algorithms.programs import begun

from .envs.probes import MultiDiscreteMatch
from .tiny import quick_compiles, trained
from .trees.test_prune_on import assert_no_split_is_idle

__all__ = ["quick_compiles"]

ENVS = {
    "discrete": ("CartPole-v1", {}),
    "box": ("Pendulum-v1", {"learning_rate_leaf_values": 0.1}),
    "multi_discrete": (MultiDiscreteMatch(), {"feature_names": ("first sign", "second sign")}),
}


@pytest.fixture(scope="module", params=ENVS)
def one(request) -> sympol.PPO:
    env, options = ENVS[request.param]
    return trained(env, **options)


@pytest.mark.slow
def test_trained_extracted_pruned_json_sklearn_and_python_agree_python_on_100_000(one):
    full = one.tree(prune=False)
    visited = play(full, one.spec, 20, seed=0, deterministic=False).observations
    x = no_loss.observations(full, visited, np.random.default_rng(0), 1_000_000)
    assert x.shape == (1_000_000, full.n_features)
    assert ((x >= full.feature_low) & (x <= full.feature_high)).all()
    assert len(np.unique(full.apply(x))) > 2
    counts = no_loss.disagreements(one, x, python_on=100_000)
    assert counts == {"extracted": 0, "pruned": 0, "json": 0, "sklearn": 0, "python": 0}


TASKS = (
    "MiniGrid-Empty-Random-6x6-v0",
    "MiniGrid-DoorKey-5x5-v0",
    "MiniGrid-LavaGapS5-v0",
    "MiniGrid-LavaGapS7-v0",
    "MiniGrid-DistShift1-v0",
    "sympol/DistShift-Random-v0",
)


def untrained(env_id: str, depth: int) -> sympol.PPO:
    """The random tree that a training begins with."""
    agent = sympol.PPO("tree", env_id, depth=depth, seed=depth)
    agent.state = begun(agent.spec.env or agent.spec, agent.config, agent.seed)
    return agent


def assert_no_loss_on_all_there_is(agent: sympol.PPO) -> None:
    x = agent.spec.all_observations()
    assert x is not None
    counts = no_loss.disagreements(agent, x)
    assert counts == dict.fromkeys(("extracted", "pruned", "pruned_on_all", "json", "sklearn", "python"), 0)
    full, tree = agent.tree(prune=False), agent.tree()
    assert tree.n_nodes <= full.prune().n_nodes < full.n_nodes
    assert tree.prune(observations=x) == tree
    assert_no_split_is_idle(tree, x)


@pytest.mark.parametrize("depth", [6, 8])
@pytest.mark.parametrize("env_id", TASKS)
def test_no_loss_on_all_reachable_minigrid_observations(env_id, depth):
    assert_no_loss_on_all_there_is(untrained(env_id, depth))


@pytest.mark.parametrize("env_id", ["MiniGrid-DoorKey-5x5-v0", "sympol/DistShift-Random-v0"])
def test_no_loss_on_all_reachable_observations_after_training(env_id):
    options = {"depth": 6, "learning_rate_leaf_values": 0.05, "learning_rate_feature_logits": 0.05}
    assert_no_loss_on_all_there_is(trained(env_id, **options))


def test_a_disagreement_would_be_seen(one, monkeypatch):
    tree = one.tree(prune=False)
    x = no_loss.observations(tree, None, np.random.default_rng(0), 30_000)
    visits = tree.with_visits(x).n_node_samples
    low, high = (np.take(bound, tree.feature, mode="clip") for bound in (tree.feature_low, tree.feature_high))
    met = ~tree.is_leaf & (low <= tree.threshold) & (tree.threshold < high)
    inner = np.argmax(np.where(met, visits, -1))
    moved = tree.threshold.copy()
    moved[inner] = np.nextafter(moved[inner], np.float32(np.inf))
    other = dataclasses.replace(tree, threshold=moved)
    monkeypatch.setattr(no_loss, "readers", lambda agent: {"moved": other.apply})
    monkeypatch.setattr(no_loss, "trained_policy", lambda agent: tree.apply)
    assert no_loss.disagreements(one, x)["moved"] > 0


def test_the_benchmark_writes_its_result(tmp_path, monkeypatch, capsys):
    trained().save(tmp_path / "run")
    monkeypatch.setattr(timing, "ROOT", tmp_path)
    monkeypatch.setattr(no_loss, "NUM_OBSERVATIONS", 3_000)
    no_loss.main([str(tmp_path / "run")])
    (run,) = json.loads((tmp_path / "studies" / "results" / "no_loss.json").read_text())[
        "environments"
    ].values()
    assert run["observations"] == 3_000
    assert set(run["disagreements"].values()) == {0}
    assert "written to" in capsys.readouterr().out
