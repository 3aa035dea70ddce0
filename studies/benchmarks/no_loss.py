"""Is what is read what was trained? Count the observations on which the readers disagree with the trained policy.

    python -m studies.benchmarks.no_loss RUN...        writes studies/results/no_loss.json

Observations: all there can be, where they are listed (MiniGrid). Elsewhere a million, all within the bounds of the
space (pruning by bounds is proven there and nowhere else): a third random, a third near visited ones, a third exactly
on thresholds, beside them, on bounds, subnormal.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

import sympol
from sympol.agents import Agent
from sympol.play import play
from sympol.policies.distributions import distribution_of
from sympol.provenance import versions
from sympol.trees import DecisionTree

from .timing import arguments_of, write_environments

SPECIAL = np.array(
    [0, -0.0, 1e-40, -1e-40, 1.1754942e-38, 1.1754944e-38, -1.1754944e-38, 1e-20, -1e-20], np.float32
)
NUM_OBSERVATIONS = 1_000_000
SEED = 12


def observations(
    tree: DecisionTree, visited: np.ndarray | None, rng: np.random.Generator, n: int
) -> np.ndarray:
    """``[n, features]`` float32 within the bounds of the space, in random order."""
    low, high = (np.asarray(bound, np.float64) for bound in (tree.feature_low, tree.feature_high))
    shape = (n // 3, tree.n_features)
    wide = rng.normal(size=shape) * 10 ** rng.uniform(-3, 3, size=shape)
    bounded = np.isfinite(low) & np.isfinite(high) & (high - low < 1e6)
    anywhere = np.where(
        bounded, rng.uniform(np.where(bounded, low, 0), np.where(bounded, high, 1), shape), wide
    )

    if visited is None or len(visited) == 0:
        visited = anywhere.astype(np.float32)
    near = visited[rng.integers(len(visited), size=n // 3)].astype(np.float64)
    near += np.where(rng.random(shape) < 0.5, 0, rng.normal(size=shape) * 0.1 * visited.std(axis=0))

    exact = np.empty((n - 2 * (n // 3), tree.n_features), np.float32)
    for feature in range(tree.n_features):
        t = np.append(tree.threshold[tree.feature == feature], SPECIAL)
        t = np.concatenate([t, tree.feature_low[[feature]], tree.feature_high[[feature]]])
        t = t[np.isfinite(t)]
        steps = [np.nextafter(t, np.float32(-np.inf)), np.nextafter(t, np.float32(np.inf))]
        exact[:, feature] = rng.choice(np.concatenate([t, *steps]), len(exact))
    replaced = rng.random(exact.shape) < 0.3
    exact[replaced] = anywhere[rng.integers(len(anywhere), size=len(exact))][replaced]

    x = np.concatenate([anywhere.astype(np.float32), near.astype(np.float32), exact])
    return rng.permutation(np.clip(x, tree.feature_low, tree.feature_high))


def trained_policy(agent: Agent) -> Callable[[np.ndarray], np.ndarray]:
    """What acts in training when it does not sample: in JAX, scaling included, straight from the parameters."""
    state, space = agent.state, agent.spec.action_space
    assert state is not None
    actor = state.validation.best_actor if agent.config.select_best else state.networks.actor
    distribution = distribution_of(space)

    @jax.jit
    def act(actor: Any, normalizer: Any, x: jax.Array) -> jax.Array:
        return distribution.to_env(distribution.mode(actor.rollout()(normalizer(x))))

    def native(x: np.ndarray) -> np.ndarray:
        action = np.asarray(act(actor, state.normalizer, x))
        return action + np.asarray(getattr(space, "start", 0), action.dtype)  # the policy counts from zero

    return native


def readers(agent: Agent) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """All that claims to be this policy; where all observations are listed, pruned on them or only as elsewhere."""
    full, tree = agent.tree(prune=False), agent.tree()
    program: dict[str, Any] = {"__name__": "policy"}
    exec(compile(tree.to_python(), "policy.py", "exec"), program)
    act, estimator = program["act"], tree.to_sklearn(names=False)
    listed = {} if agent.spec.all_observations() is None else {"pruned_on_all": tree.predict}
    return {
        "extracted": full.predict,
        "pruned": full.prune().predict,
        **listed,
        "json": DecisionTree.from_json(tree.to_json()).predict,
        "sklearn": estimator.predict,
        "python": lambda x: np.array([act(row) for row in x.tolist()]),
    }


def disagreements(agent: Agent, x: np.ndarray, *, python_on: int | None = None) -> dict[str, int]:
    """On how many observations each reader does something else; generated Python on the first ``python_on``."""
    expected = trained_policy(agent)(x).reshape(len(x), -1)
    counts = {}
    for name, act in readers(agent).items():
        n = len(x) if name != "python" or python_on is None else min(python_on, len(x))
        acted = np.asarray(act(x[:n])).reshape(n, -1)
        counts[name] = int(np.count_nonzero((acted != expected[:n]).any(axis=1)))
    return counts


def measure(run: Path) -> dict[str, Any]:
    """One finished run."""
    agent = sympol.load(run)
    x = agent.spec.all_observations()
    if x is None:
        full = agent.tree(prune=False)
        visited = play(full, agent.spec, 20, seed=SEED, deterministic=False).observations
        x = observations(full, visited, np.random.default_rng(SEED), NUM_OBSERVATIONS)
    return {
        "run": run.name,
        "env": agent.spec.name,
        "seed": agent.seed,
        "nodes": agent.tree().n_nodes,
        "observations": len(x),
        "actions_taken": len(np.unique(agent.tree().apply(x))),
        "disagreements": disagreements(agent, x),
    }


def main(words: list[str] | None = None) -> None:
    """Count, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="the folder of a finished run")
    given = parser.parse_args(words)
    results = {result["env"]: result for result in map(measure, given.runs)}
    for env, result in results.items():
        print(f"{env} seed {result['seed']}: {result['disagreements']}")
    print(f"written to {write_environments('no_loss', {'versions': versions()}, results)}")


if __name__ == "__main__":
    main()
