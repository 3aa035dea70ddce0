"""Training within a limit of size: the tree is never larger, and what acts is that tree."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete

import sympol
from sympol import DecisionTree, Start
from sympol.agents import Agent, Report
from sympol.algorithms.config import Config, ConfigError
from sympol.bench.methods import same_config
from sympol.functional import hard_tree
from sympol.policies.extract import extract_tree
from sympol.policies.tree import Tree
from sympol.search.prunings import apply_prunings, prune_moves
from sympol.search.size_limit import MASKED, extract_unmasked, mask_nodes, mask_state, prune_step
from sympol.trees import ActionSpec
from tests.tiny import TINY, Chain, flags, quick_compiles, read_summary, refused, status_of
from tests.trees.samples import ACTIONS, telling_observations

__all__ = ["quick_compiles"]

SMALL: dict[str, Any] = {**TINY, "max_nodes": 5, "num_eval_episodes": 2}


def agent(algorithm: type[Agent] = sympol.PPO, env: Any = "CartPole-v1", **options: Any) -> Agent:
    config = {**SMALL, **options}
    if algorithm is sympol.A2C:
        config = {
            name: value for name, value in config.items() if name not in ("minibatch_size", "num_epochs")
        }
    return algorithm("tree", env, **config)


def until(begun: Agent, timestep: int) -> Agent:
    return begun.learn(callback=lambda report: report.timestep < timestep, progress_bar=False)


def acts_as(tried: Agent, tree: DecisionTree, n: int = 3000) -> bool:
    """Whether an agent does what a tree does, on thresholds and beside them, at infinity and NaN."""
    x = telling_observations(tried.tree(prune=False), np.random.default_rng(0), n)
    given = tried.act(x, deterministic=True, rng=np.random.default_rng(0))
    return bool((given == tree.predict(x)).all())


def drawn(seed: int, kind: str, depth: int = 4) -> Tree:
    actions = ACTIONS[kind]
    std = actions.n_outputs if kind == "box" else 0
    return Tree.create(
        jax.random.key(seed), depth=depth, num_features=3, num_outputs=actions.n_outputs, num_std=std
    )


SHIFT, SCALE = np.float32([0.1, -3, 0]), np.float32([0.7, 2, 1e-3])


def cut_down(actor: Tree, actions: ActionSpec, rng: np.random.Generator, to: int) -> DecisionTree:
    """A random part of the extracted tree, as pruning makes them."""
    tree = extract_tree(actor, SHIFT, SCALE, actions=actions)
    x = rng.normal(size=(200, tree.n_features)).astype(np.float32) * np.float32([1, 1, 1000])
    while tree.n_nodes > to:
        found = prune_moves(tree, x)
        tree = apply_prunings(tree, [found[int(rng.integers(len(found)))]])
        tree = tree.prune(bounds=False) if rng.random() < 0.3 else tree
    return tree


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("seed", range(6))
def test_a_pruned_tree_lies_in_the_complete_one_and_acts_there(kind, seed):
    rng, actor, actions = np.random.default_rng(seed), drawn(seed, kind), ACTIONS[kind]
    small = cut_down(actor, actions, rng, to=int(rng.choice([1, 3, 7, 11])))
    closed = mask_nodes(actor, SHIFT, SCALE, small)
    found = extract_unmasked(closed, SHIFT, SCALE, actions=actions)
    assert replace(found, n_node_samples=None) == replace(small, n_node_samples=None)
    x = telling_observations(small, rng, 2000)
    np.testing.assert_array_equal(found.predict(x), small.predict(x))
    # the compiled program acts alike, where features are numbers
    x = x[(np.abs(x) < 1e9).all(axis=1)]
    values = np.asarray(closed.rollout()(jnp.asarray((x - SHIFT) * SCALE)))
    np.testing.assert_array_equal(actions.decide(values), small.predict(x))


def test_questions_that_are_asked_in_many_places_are_found_in_the_right_one():
    nowhere, actions = 0, ACTIONS["discrete"]
    for seed in range(40):
        rng, actor = np.random.default_rng(seed), drawn(seed, "discrete")
        few = jnp.asarray(rng.choice(np.float32([-0.5, 0.5]), actor.thresholds.shape))
        actor = replace(actor, thresholds=few)
        small = cut_down(actor, actions, rng, to=int(rng.choice([5, 7, 9])))
        found = extract_unmasked(mask_nodes(actor, SHIFT, SCALE, small), SHIFT, SCALE, actions=actions)
        assert replace(found, n_node_samples=None) == replace(small, n_node_samples=None)
        other = cut_down(replace(actor, thresholds=-few), actions, rng, to=9)
        try:
            mask_nodes(actor, SHIFT, SCALE, other)
        except ValueError:
            nowhere += 1
    assert nowhere > 20


@pytest.mark.parametrize("spare", [1, 3, 100])
def test_spare_splits_stay_open_and_change_nothing_yet(spare):
    rng, actor, actions = np.random.default_rng(1), drawn(1, "discrete"), ACTIONS["discrete"]
    small = cut_down(actor, actions, rng, to=5)
    found = extract_unmasked(mask_nodes(actor, SHIFT, SCALE, small, spare), SHIFT, SCALE, actions=actions)
    assert found.n_nodes == small.n_nodes + 2 * spare if spare < 100 else small.n_nodes < found.n_nodes <= 31
    x = telling_observations(found, rng, 2000)
    np.testing.assert_array_equal(found.predict(x), small.predict(x))


def test_a_tree_of_somebody_else_does_not_lie_there():
    actor, other = drawn(2, "discrete"), drawn(3, "discrete")
    small = cut_down(other, ACTIONS["discrete"], np.random.default_rng(0), to=7)
    with pytest.raises(ValueError, match="it was not pruned out of it"):
        mask_nodes(actor, SHIFT, SCALE, small)


@pytest.mark.parametrize("surrogate", ["sigmoid", "softsign"])
@pytest.mark.parametrize("temperature", [2.0**-10, 1.0, 2.0**10])
def test_closed_nodes_learn_nothing_and_the_others_as_if_they_were_not_there(surrogate, temperature):
    rng, actor = np.random.default_rng(4), drawn(4, "discrete")
    small = cut_down(actor, ACTIONS["discrete"], rng, to=7)
    closed = mask_nodes(actor, np.float32([0, 0, 0]), np.float32([1, 1, 1]), _unscaled(actor, small))
    x = jnp.asarray(rng.normal(size=(300, 3)), jnp.float32) / temperature
    weights = jnp.asarray(rng.normal(size=(300, 3)), jnp.float32)

    def loss(logits: Any, thresholds: Any, leaves: Any) -> Any:
        return jnp.sum(weights * hard_tree(logits, thresholds / temperature, leaves, x, surrogate=surrogate))

    gradient = jax.grad(loss, argnums=(0, 1, 2))(closed.feature_logits, closed.thresholds, closed.leaf_values)
    is_closed = (np.abs(np.asarray(closed.thresholds)) == np.float32(MASKED)).all(axis=1)
    assert is_closed.any()
    for part in gradient:
        assert np.isfinite(part).all()
    for part in gradient[:2]:
        assert not np.asarray(part)[is_closed].any()
        assert np.asarray(part)[~is_closed].any()
    met = np.flatnonzero(np.asarray(gradient[2]).any(axis=1))
    assert len(met) == small.n_leaves


def _unscaled(actor: Tree, small: DecisionTree) -> DecisionTree:
    """The same part of the tree over observations that need no scale."""
    scaled, plain = (
        extract_tree(actor, *affine, actions=small.actions)
        for affine in ((SHIFT, SCALE), (np.zeros(3, np.float32), np.ones(3, np.float32)))
    )
    known = {
        (int(f), float(t)): p
        for f, t, p in zip(scaled.feature, scaled.threshold, plain.threshold, strict=True)
    }
    pairs = zip(small.feature.tolist(), small.threshold.tolist(), strict=True)
    return replace(small, threshold=np.array([known[pair] for pair in pairs]))


@pytest.mark.parametrize("algorithm", [sympol.PPO, sympol.A2C])
def test_the_tree_is_never_larger_and_is_what_acts(algorithm):
    sizes: list[int] = []

    def check(report: Report) -> None:
        for prune in (True, False):
            assert report.agent.tree(prune=prune).n_nodes <= 5
        assert acts_as(report.agent, report.agent.tree(prune=False))
        assert np.isfinite(report.metrics["eval/mean_reward"])
        sizes.append(report.agent.tree().n_nodes)

    trained = agent(algorithm, num_evals=4).learn(callback=check, progress_bar=False)
    assert len(sizes) == 4
    assert acts_as(trained, trained.tree(prune=False))
    within = trained.tree()
    x = telling_observations(within, np.random.default_rng(1), 3000)
    x = x[((x >= within.feature_low) & (x <= within.feature_high)).all(axis=1)]
    np.testing.assert_array_equal(within.predict(x), trained.tree(prune=False).predict(x))


def test_from_its_moment_on_the_shape_stays_and_the_rest_learns():
    config = {**SMALL, "select_best": False, "rollback": False, "learning_rate_thresholds": 10.0}
    before = until(agent(**config), prune_step(agent().config))
    begun = _parameters(before)
    ended = _parameters(before.learn(progress_bar=False))
    closed = (np.abs(begun.thresholds) == np.float32(MASKED)).all(axis=1)
    assert closed.any()
    assert begun.thresholds[closed].tobytes() == ended.thresholds[closed].tobytes()
    assert (begun.thresholds[~closed] != ended.thresholds[~closed]).any()
    assert (begun.leaf_values != ended.leaf_values).any()


def test_what_is_validated_is_the_tree_in_its_shape():
    """At the moment the first best one is the pruned tree; what is best later is no worse, and as small."""
    at = until(agent(), prune_step(agent().config))
    assert at.state is not None
    first = float(at.state.validation.best_return)
    assert first == float(at.state.validation.last_return)
    assert at.state.validation.best_timestep == at.state.timestep
    assert float(at.state.validation.lr_factor) == 1
    at.learn(progress_bar=False)
    assert float(at.state.validation.best_return) >= first


def test_validation_begins_anew():
    begun = until(agent(), 256)
    assert begun.state is not None
    made = mask_state(begun.state, begun.policy.extracted_tree, begun.spec, begun.config, begun.seed)
    assert made.validation.best_return == -np.inf
    best, actor = made.validation.best_actor, made.networks.actor
    assert np.asarray(best.thresholds).tobytes() == np.asarray(actor.thresholds).tobytes()
    assert begun.tree(prune=False).n_nodes <= 5


def _parameters(trained: Agent) -> Tree:
    assert trained.state is not None
    actor: Any = trained.state.networks.actor
    return jax.tree.map(np.asarray, actor)


@pytest.mark.parametrize("stop", [256, 512, 1024])
def test_stopped_saved_and_resumed_it_ends_as_if_it_had_not_been(tmp_path, stop):
    whole = agent().learn(progress_bar=False)
    until(agent(), stop).save(tmp_path / "run")
    resumed = sympol.load(tmp_path / "run")
    assert resumed.num_timesteps == stop
    assert resumed.tree().n_nodes <= 5
    resumed.learn(progress_bar=False)
    assert resumed.tree() == whole.tree()
    for mine, theirs in zip(jax.tree.leaves(resumed.state), jax.tree.leaves(whole.state), strict=True):
        assert np.asarray(mine).tobytes() == np.asarray(theirs).tobytes()


def test_without_a_limit_nothing_is_as_small_and_the_program_is_the_same():
    assert Config(max_nodes=7, node_price=0.5).static() == Config().static()
    free = agent(max_nodes=0).learn(progress_bar=False)
    assert free.tree(prune=False).n_nodes == 15


SPACES = {
    "discrete": (Box(-1, 1, (3,)), Discrete(3, start=2)),
    "multi_discrete": (Box(-1, 1, (3,)), MultiDiscrete([2, 3])),
    "box": (Box(-1, 1, (3,)), Box(-2, 2, (2,))),
}


@pytest.mark.parametrize("kind", SPACES)
def test_what_the_host_steps_has_its_limit_too(kind):
    observed, acted = SPACES[kind]
    options = {"total_timesteps": 512, "num_evals": 3, "max_nodes": 3, "env": lambda: Chain(observed, acted)}
    trained = agent(**options).learn(progress_bar=False)
    assert trained.tree(prune=False).n_nodes <= 3
    assert acts_as(trained, trained.tree(prune=False))
    assert agent(**options).learn(progress_bar=False).tree() == trained.tree()


def test_a_price_prunes_what_is_not_worth_it():
    free = agent(max_nodes=0, node_price=1000.0, num_evals=2).learn(progress_bar=False)
    assert free.tree(prune=False).n_nodes == 1


def test_a_tree_to_start_from_is_within_the_limit_from_the_start():
    large = agent(max_nodes=0).learn(progress_bar=False).tree(prune=False)
    assert large.n_nodes == 15
    begun = agent(start=large)
    assert begun.tree().n_nodes <= 5
    assert begun.learn(progress_bar=False).tree().n_nodes <= 5


def test_frozen_nodes_and_a_limit_do_not_go_together():
    tree = agent(max_nodes=0, num_evals=1).learn(progress_bar=False).tree(prune=False)
    for limit in ({"max_nodes": 5}, {"max_nodes": 0, "node_price": 1.0}):
        with pytest.raises(ConfigError, match=r"nodes 0, 2 are frozen.*leave one of the two out"):
            agent(start=Start(tree, freeze=(2, 0)), **limit)


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (
            {"max_nodes": 6},
            "max_nodes must be odd, as a tree has one leaf more than it has splits, got 6: choose 5 or 7",
        ),
        ({"max_nodes": -1}, "max_nodes must be between 0 and 32767, got -1"),
        ({"max_nodes": 7.5}, "max_nodes must be a whole number"),
        ({"node_price": -0.1}, "node_price must be between 0"),
        ({"policy": "mlp", "max_nodes": 7}, "max_nodes belongs to tree; mlp has none"),
        ({"policy": "sdt", "node_price": 1.0}, "node_price belongs to tree; sdt has none"),
    ],
)
def test_limits_that_make_no_sense_are_refused(config, said):
    with pytest.raises(ConfigError, match=re.escape(said)):
        Config(**config)


def test_what_was_measured_before_there_were_limits_is_as_good_as_new():
    was = Config(depth=3).to_dict()
    assert not {"max_nodes", "node_price"} & was.keys()
    limited = Config(depth=3, max_nodes=7)
    assert not same_config({"training": was}, {"training": limited.to_dict()})
    assert Config.from_dict(was) == Config(depth=3)
    assert Config.from_dict(limited.to_dict()) == limited


def test_from_the_command_line(tmp_path, capsys):
    run = tmp_path / "run"
    config = flags({**SMALL, "node_price": 0.001})
    line = ["train", "CartPole-v1", "--eval-episodes", "2", "--run-dir", run, *config]
    assert status_of(*line) == 0
    said = capsys.readouterr()
    assert "training a tree of depth 3, at most 5 nodes, a return of 0.001 a node on CartPole-v1" in said.err
    assert "; 5 were allowed; a node had to be worth 0.001)" in said.out
    summary = read_summary(run)
    assert summary["max_nodes"] == 5
    assert summary["nodes"] <= summary["nodes_unpruned"] <= 5
    assert DecisionTree.from_json((run / "policy.json").read_text()).n_nodes == summary["nodes"]
    for other in ("7", "0"):
        line[line.index("--max-nodes") + 1] = other
        assert f"was begun with max_nodes 5, not {other}" in refused(capsys, *line, "--resume")
    assert "choose 3 or 5" in refused(capsys, "train", "CartPole-v1", "--max-nodes", "4")
    assert json.loads((run / "summary.json").read_text())["env"] == "CartPole-v1"


def test_all_there_is_to_see_counts():
    """MiniGrid lists all observations: below the limit nothing is left that no observation needs."""
    trained = agent(env="MiniGrid-Empty-Random-6x6-v0", total_timesteps=1024, num_evals=2)
    trained.learn(progress_bar=False)
    tree = trained.tree()
    assert tree.n_nodes <= 5
    assert tree == tree.prune(observations=trained.spec.all_observations())
