"""The best policy of a small world that sees what a tree sees and remembers nothing: an action for each observation.

All of the world is known (`tabular`), so a policy is followed from every start in a moment. The search begins with what
the shortest ways do in states that look alike, then changes the action of one observation at a time, of some changes
the best, until none gains anything; from there some actions at random, and again. What is earned from all other states
counts a little, too: where no start leads to the goal yet, it says which way it lies. (Iterated local search; nothing
proves that what it ends with is the best, except where every start is solved in as few steps as there can be.)
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from ..envs.capabilities import StateGraph, steps_to_goal
from ..seeds import SeedStream
from .budget import Budget
from .evaluators.tabular import TabularEvaluator, path, play_table

EPISODES = 1024
"""Whose starts are looked at."""
ANYWHERE = 256
"""States besides the starts that count a little."""
LITTLE = 1e-3
PATIENCE = 30
"""Changes at random in a row without a gain, after which the search begins anew."""
BLOCK = 64
"""Changes that are tried together."""
GAIN = 1e-9
"""Below that, a difference is rounding."""


class Lookup(NamedTuple):
    """A policy as a table."""

    observations: Float32[np.ndarray, "observations features"]
    """On which it acts, coming from any start."""
    actions: Int[np.ndarray, " observations"]
    """What it does there."""
    mean: float
    """Its mean return."""
    is_best: bool
    """Whether no policy can earn more, be it one with memory."""
    steps: int
    """State transitions read from the table so far."""


def best_lookup(evaluator: TabularEvaluator, *, budget: Budget, seed: int = 0) -> Lookup:
    """Search until nothing can be better, or the budget is spent. With a budget in steps, the same seed ends alike."""
    search = _Search(evaluator.graph, evaluator.starts(range(EPISODES)), SeedStream(seed).generator())
    began = time.perf_counter()
    best, mean = search.begin(), -np.inf
    for act in search.policies():
        earned = search.earned(act)
        if earned > mean + GAIN:
            best, mean = act, earned
        if (
            mean >= search.most - GAIN
            or search.steps >= budget.steps
            or time.perf_counter() - began >= budget.seconds
        ):
            break
    seen = search.seen(best)
    return Lookup(
        evaluator.graph.observations[seen], best[seen], mean, mean >= search.most - GAIN, search.steps
    )


class _Search:
    """Policies are integer arrays, an action for each observation of the world."""

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
        """In each observation what shortest ways do in most states that look so, states weighed at random."""
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
        """Policies on the way up, again and again, for ever."""
        while True:
            top, top_score, fails = self.begin(), -np.inf, 0
            act = top
            while fails < PATIENCE:
                act, score = yield from self._climb(act)
                fails += 1
                if score > top_score + GAIN:
                    top, top_score, fails = act, score, 0
                act = top.copy()
                some = self.rng.integers(self.shape[0], size=self.rng.integers(2, 6))
                act[some] = self.rng.integers(self.shape[1], size=len(some))

    def earned(self, act: Int[np.ndarray, " observations"]) -> float:
        """The mean return."""
        return float(self._returns(act[None], self.starts)[0] @ self.weights)

    def seen(self, act: Int[np.ndarray, " observations"]) -> Bool[np.ndarray, " observations"]:
        """Which observations the policy acts on, from any start."""
        ways = (path(self.graph, act, start) for start in self.starts.tolist())
        return np.isin(
            np.arange(self.shape[0]), self.graph.observation_of[[state for way in ways for state in way]]
        )

    def _climb(
        self, act: Int[np.ndarray, " observations"]
    ) -> Generator[Int[np.ndarray, " observations"], None, tuple[Int[np.ndarray, " observations"], float]]:
        """Of some changes the best, of some others the best, until all were tried in vain; the end, and its score."""
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
        return own + LITTLE * self._returns(acts, self.anywhere).mean(axis=1)

    def _returns(
        self, acts: Int[np.ndarray, "policies observations"], states: Int[np.ndarray, " states"]
    ) -> Float[np.ndarray, "policies states"]:
        returns, lengths = play_table(self.graph, acts, states)
        self.steps += int(lengths.sum(dtype=np.int64))
        return returns.astype(float)
