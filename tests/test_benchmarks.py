"""What the benchmarks measure beside time is true: the greatest returns, the starts that are solved."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from studies.benchmarks import minigrid, small_grids, timing
from studies.galleries.fronts import load_all
from studies.galleries.published import targets

from sympol.envs.minigrid import TASKS, make, make_host
from sympol.envs.minigrid.state_graph import all_starts
from sympol.trees import DecisionTree, DiscreteActions

from .envs.minigrid_worlds import World, load_world, worlds_of
from .tiny import TINY, quick_compiles

__all__ = ["quick_compiles"]


def test_returns_from_all_starts_are_those_on_farama_s_package():
    env_id = "MiniGrid-Empty-Random-6x6-v0"
    env, host = make(env_id), make_host(env_id)
    rng = np.random.default_rng(0)
    for _ in range(1000):
        tree = DecisionTree.from_complete(
            rng.integers(env.view.num_features, size=7),
            np.full(7, 0.5),
            np.eye(3)[rng.integers(3, size=8)],
            actions=DiscreteActions(3),
            feature_names=env.feature_names,
            groups=env.groups,
        )
        earned, best = minigrid.returns_from_all_starts(tree, env)
        if 10 < (earned > 0).sum() < 50:
            break
    starts = all_starts(env)
    assert starts is not None
    worlds = worlds_of(env, starts)
    theirs = []
    for start in range(len(earned)):
        host.reset(seed=0)
        load_world(host, World(*(part[start] for part in worlds)))
        observation, *_ = host.step(0)  # a turn to the left and back: there is no observing without a step
        observation, *_ = host.step(1)
        host.unwrapped.step_count = 0  # type: ignore[attr-defined]
        done, total = False, 0.0
        while not done:
            observation, reward, terminated, truncated, _ = host.step(tree.predict(observation))
            done, total = terminated or truncated, total + float(reward)
        theirs.append(total)
    np.testing.assert_allclose(earned, theirs, rtol=1e-12)
    assert (earned <= best).all()


def test_the_small_grids_in_the_docs_are_those_measured_and_of_the_trees_that_are_kept():
    measured = json.loads(
        (timing.ROOT / "studies" / "results" / "small_grids.json").read_text(encoding="utf-8")
    )["tasks"]
    text = (timing.ROOT / "docs" / "guides" / "pareto.md").read_text(encoding="utf-8")
    shown = text.split("<!-- small grids: tests/test_benchmarks.py -->\n")[1].split(
        "<!-- end small grids -->"
    )[0]
    assert shown.strip() == small_grids.markdown(measured).strip()
    kept = {fronts[0].environment: fronts for fronts in load_all(timing.ROOT)}
    assert {name for name in kept if name in TASKS} == set(measured)
    name = "MiniGrid-LavaGapS7-v0"
    [target] = targets(name)
    again = small_grids.measured(kept[name], target.nodes, measured[name]["without_memory_at_most"])
    assert again == measured[name]


@pytest.mark.slow
def test_a_small_run_of_minigrid(tmp_path, monkeypatch, capsys):
    measure = minigrid.measure

    def small(env: str, seed: int, episodes: int, options: dict[str, Any]) -> dict[str, Any]:
        return measure(env, seed, episodes, {**TINY, **options})

    monkeypatch.setattr(minigrid, "measure", small)
    monkeypatch.setattr(timing, "ROOT", tmp_path)
    env = "MiniGrid-LavaGapS5-v0"
    monkeypatch.setattr("sys.argv", ["minigrid", env, "--seeds=2", "--timesteps=2048", "--episodes=8"])
    minigrid.main()
    assert "minigrid.json" in capsys.readouterr().out
    result = json.loads((tmp_path / "studies" / "results" / "minigrid.json").read_text())["environments"][env]
    assert result["disagreements"] == 0
    for row in result["trainings"]:
        assert row["starts"] == 3
        assert row["return_mean"] <= row["best_return_mean"]
        assert 0 <= row["share_of_best_mean"] <= 1
        assert row["nodes"] <= row["nodes_by_groups"] <= row["nodes_unpruned"] == 15
