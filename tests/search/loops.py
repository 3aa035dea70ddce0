"""Trees of any shape, and plain loops that play them: what evaluators are compared with."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec
from sympol.play import PURPOSE_TAGS
from sympol.search.evaluators.base import Returns
from sympol.trees import DecisionTree

SEED = 7


@functools.cache
def spec_of(name: str) -> EnvSpec:
    return resolve(name)


def grown(spec: EnvSpec, n_leaves: int, seed: int) -> DecisionTree:
    """A tree of any shape: splits are put at leaves drawn at random, thresholds among what there is to see."""
    rng, features = np.random.default_rng(seed), spec.features
    low, high = (np.clip(bound, -0.3, 0.3) for bound in (features.low, features.high))

    def node(n: int) -> list[Any]:
        if n == 1:
            return [{"value": rng.normal(size=spec.actions.n_outputs)}]
        left = int(rng.integers(1, n))
        feature = int(rng.integers(len(low)))
        one_hot = low[feature] == 0
        threshold = 0.5 if one_hot else rng.choice([0.0, *rng.uniform(low[feature], high[feature], 3)])
        return [{"feature": feature, "threshold": threshold}, node(left), node(n - left)]

    rows: list[dict[str, Any]] = []

    def lay(part: list[Any]) -> int:
        at = len(rows)
        rows.append(dict(part[0]))
        if len(part) == 3:
            rows[at]["left"], rows[at]["right"] = lay(part[1]), lay(part[2])
        return at

    lay(node(n_leaves))
    zero = np.zeros(spec.actions.n_outputs)
    return DecisionTree(
        children_left=np.array([row.get("left", -1) for row in rows]),
        children_right=np.array([row.get("right", -1) for row in rows]),
        feature=np.array([row.get("feature", -2) for row in rows]),
        threshold=np.array([row.get("threshold", -2.0) for row in rows]),
        value=np.array([row.get("value", zero) for row in rows]),
        actions=spec.actions,
        feature_names=features.names,
        feature_low=features.low,
        feature_high=features.high,
        groups=features.groups,
    )


def jax_loop(
    spec: EnvSpec, tree: DecisionTree, episode: int, purpose: Any = "refine", limit: int = 10**6
) -> tuple[np.float32, int, list[np.ndarray]]:
    """One episode of an environment written in JAX, step by step."""
    env: Any = spec.env
    reset, step = _jitted(env)
    words = jnp.asarray(np.array([PURPOSE_TAGS[purpose], SEED], np.uint32))
    reset_key, step_key = jax.random.split(jax.random.fold_in(jax.random.wrap_key_data(words), episode))
    state, x = reset(reset_key)
    total, seen = np.float32(0), []
    while True:
        seen.append(np.asarray(x))
        action = np.asarray(tree.predict(seen[-1]))
        action = action.astype(np.float32 if action.dtype.kind == "f" else np.int32)
        state, (x, reward, terminated, truncated) = step(
            jax.random.fold_in(step_key, len(seen) - 1), state, action
        )
        total = total + np.float32(reward)
        if terminated or truncated or len(seen) >= limit:
            return total, len(seen), seen


@functools.cache
def _jitted(env: Any) -> tuple[Any, Any]:
    return jax.jit(env.reset), jax.jit(env.step)


def looped(spec: EnvSpec, trees: list[DecisionTree], episodes: range, purpose: Any = "refine") -> Returns:
    results = [[jax_loop(spec, tree, episode, purpose)[:2] for episode in episodes] for tree in trees]
    returns, lengths = (np.array([[result[i] for result in row] for row in results]) for i in (0, 1))
    return Returns(returns.astype(np.float32), lengths.astype(np.int32))


def assert_same(ours: Returns, theirs: Returns, *, exact: bool = True) -> None:
    np.testing.assert_array_equal(ours.lengths, theirs.lengths)
    np.testing.assert_allclose(
        ours.returns, theirs.returns, rtol=0 if exact else 2e-5, atol=0 if exact else 1e-4
    )
    assert ours.returns.dtype == np.float32
    assert ours.lengths.dtype == np.int32


def of_parity(spec: EnvSpec, swapped: bool) -> DecisionTree:
    values = np.eye(2)[::-1] if swapped else np.eye(2)
    names = spec.features.names
    return DecisionTree.from_complete(
        np.array([0]), np.array([0.5]), values, actions=spec.actions, feature_names=names
    )
