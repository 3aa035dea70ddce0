"""What acts in a run."""

from __future__ import annotations

from ..agents import Agent, load_run
from ..runs.run import Run
from ..trees import DecisionTree


def policy_of(run: Run) -> Agent | DecisionTree:
    """What acts: the tree, which needs nothing else to be read, or the agent whose policy is none.

    Raises:
        RunError: there is no policy yet, or it cannot be read.
    """
    return run.load_tree() if run.has_tree else load_run(run)
