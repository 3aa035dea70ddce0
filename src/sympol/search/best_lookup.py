"""The best memoryless policy of an environment whose states are listed: an action for each observation.

All transitions are known (`sympol.search.evaluators.tabular`), so a policy is played from every start in a moment. This
is an iterated local search. It begins with the actions of shortest paths, by a vote of the states that have the same
observation; then it changes the action of one observation at a time, the best of a block of changes, until none gains
anything; then a few actions at random, and again. Returns from all other states count a little, too: where no start
leads to the goal yet, they show the direction. The result is proven to be the best only where every start is solved in
the fewest steps possible.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from ..envs.capabilities import StateGraph, steps_to_goal
from ..seeds import SeedStream
from .budget import Budget, Meter
from .evaluators.tabular import TabularEvaluator, path, play_table

EPISODES = 1024
"""Episodes whose start states are used."""
ANYWHERE = 256
"""States besides the starts that count a little."""
ANYWHERE_WEIGHT = 1e-3
"""How much they count."""
PATIENCE = 30
"""Random changes in a row without a gain, after which the search starts again."""
BLOCK = 64
"""Changes that are tried together."""
GAIN = 1e-9
"""The smallest difference that is more than rounding."""


class Lookup(NamedTuple):
    """A policy as a table."""

    observations: Float32[np.ndarray, "observations features"]
    """The observations that it reaches from any start."""
    actions: Int[np.ndarray, " observations"]
    """Its action on each of them."""
    mean: float
    """Its mean return."""
    is_best: bool
    """True where no policy can earn more, with memory or without."""
    steps: int
    """State transitions read from the table so far."""


def best_lookup(evaluator: TabularEvaluator, *, budget: Budget, seed: int = 0) -> Lookup:
    """Search the best memoryless policy.

    Args:
        evaluator: The evaluator, which knows all transitions.
        budget: How long to search; it ends earlier where nothing can be better.
        seed: With a budget in steps the same seed finds the same policy.

    Returns:
        The best policy found.
    """
    search = _Search(evaluator.graph, evaluator.starts(range(EPISODES)), SeedStream(seed).generator())
    meter = Meter(search)
    best, mean = search.begin(), -np.inf
    for act in search.policies():
        earned = search.earned(act)
        if earned > mean + GAIN:
            best, mean = act, earned
        if mean >= search.most - GAIN or not meter.has(budget):
            break
    seen = search.seen(best)
    return Lookup(
        evaluator.graph.observations[seen], best[seen], mean, mean >= search.most - GAIN, search.steps
    )


class _Search:
    """The state of a search; policies are integer arrays, an action for each observation."""

    def __init__(
        self, graph: StateGraph, starts: Int[np.ndarray, " episodes"], rng: np.random.Generator
    ) -> None:
        self.graph, self.rng, self.steps = graph, rng, 0
        self.starts, counts = np.unique(starts, return_counts=True)
        self.weights = counts / counts.sum()
        self.shape = len(graph.observations), graph.num_actions
        states = np.arange(len(graph.observation_of))
        self.anywhere = states if len(states) <= ANYWHERE else rng.choice(states, ANYWHERE, replace=False)
        rewards = np.append(graph.reward_at, 0)  # the last for what takes longer than there is time
        self.to_goal = np.minimum(steps_to_goal(graph.successor, graph.reaches_goal), len(graph.reward_at))
        self.most = float(rewards[self.to_goal[self.starts]].astype(float) @ self.weights)

    def begin(self) -> Int[np.ndarray, " observations"]:
        """Return the action of shortest paths by a vote of the states of each observation, weighted at random."""
        after = np.where(
            self.graph.reaches_goal,
            0,
            np.where(self.graph.successor >= 0, self.to_goal[self.graph.successor], np.inf),
        )
        votes = np.zeros(self.shape)
        weighed = (after + 1 == self.to_goal[:, None]) * self.rng.random((len(after), 1))
        np.add.at(votes, self.graph.observation_of, weighed)
        return votes.argmax(axis=1)

    def policies(self) -> Iterator[Int[np.ndarray, " observations"]]:
        """Yield better and better policies, from new starts again and again, for ever."""
        while True:
            top, top_score, fails = self.begin(), -np.inf, 0
            act = top
            while fails < PATIENCE:
                act, score = yield from self._climb(act)
                fails += 1
                if score > top_score + GAIN:
                    top, top_score, fails = act, score, 0
                act = top.copy()
                changed = self.rng.integers(self.shape[0], size=self.rng.integers(2, 6))
                act[changed] = self.rng.integers(self.shape[1], size=len(changed))

    def earned(self, act: Int[np.ndarray, " observations"]) -> float:
        """Return the mean return of a policy."""
        return float(self._returns(act[None], self.starts)[0] @ self.weights)

    def seen(self, act: Int[np.ndarray, " observations"]) -> Bool[np.ndarray, " observations"]:
        """Return which observations a policy reaches from any start."""
        paths = (path(self.graph, act, start) for start in self.starts.tolist())
        states = [state for one in paths for state in one]
        return np.isin(np.arange(self.shape[0]), self.graph.observation_of[states])

    def _climb(
        self, act: Int[np.ndarray, " observations"]
    ) -> Generator[Int[np.ndarray, " observations"], None, tuple[Int[np.ndarray, " observations"], float]]:
        """Take the best of one block of changes after the other, until none gains; return the policy and its score."""
        changes = self.rng.permutation(self.shape[0] * (self.shape[1] - 1))
        score, tried, at = self._scores(act[None])[0], 0, 0
        while tried < len(changes):
            observation, other = np.divmod(
                np.take(changes, range(at, at + BLOCK), mode="wrap"), self.shape[1] - 1
            )
            changed = np.repeat(act[None], BLOCK, axis=0)
            changed[np.arange(BLOCK), observation] += 1 + other
            changed %= self.shape[1]
            scores = self._scores(changed)
            best = int(scores.argmax())
            tried, at = tried + BLOCK, at + BLOCK
            if scores[best] > score + GAIN:
                act, score, tried = changed[best], scores[best], 0
            yield act
        return act, float(score)

    def _scores(self, acts: Int[np.ndarray, "policies observations"]) -> Float[np.ndarray, " policies"]:
        own = self._returns(acts, self.starts) @ self.weights
        return own + ANYWHERE_WEIGHT * self._returns(acts, self.anywhere).mean(axis=1)

    def _returns(
        self, acts: Int[np.ndarray, "policies observations"], states: Int[np.ndarray, " states"]
    ) -> Float[np.ndarray, "policies states"]:
        returns, lengths = play_table(self.graph, acts, states)
        self.steps += int(lengths.sum(dtype=np.int64))
        return returns.astype(float)
