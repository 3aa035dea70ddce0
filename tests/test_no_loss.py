"""The tree that is read is the policy that was trained, on a million observations of each kind of action."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from benchmarks import no_loss

import sympol
from sympol.evaluate import play

from .envs.probes import MultiDiscreteMatch
from .tiny import quick_compiles, trained

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
    visited = None
    if one.spec.make_host is not None:
        visited = play(full, one.spec, 20, seed=0, deterministic=False).observations
    x = no_loss.observations(full, visited, np.random.default_rng(0), 1_000_000)
    assert x.shape == (1_000_000, full.n_features)
    assert ((x >= full.feature_low) & (x <= full.feature_high)).all()
    assert len(np.unique(full.apply(x))) > 2
    counts = no_loss.disagreements(one, x, python_on=100_000)
    assert counts == {"extracted": 0, "pruned": 0, "json": 0, "sklearn": 0, "python": 0}


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
    (tmp_path / "benchmarks").mkdir()
    monkeypatch.setattr(no_loss, "__file__", str(tmp_path / "benchmarks" / "no_loss.py"))
    monkeypatch.setattr(no_loss, "NUM_OBSERVATIONS", 3_000)
    no_loss.main([str(tmp_path / "run")])
    (run,) = json.loads((tmp_path / "results" / "no_loss.json").read_text())["runs"]
    assert run["observations"] == 3_000
    assert set(run["disagreements"].values()) == {0}
    assert "written to" in capsys.readouterr().out
