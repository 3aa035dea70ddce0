"""``sympol resume``: an interrupted training, from its last checkpoint to the end."""

from __future__ import annotations

import shlex
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

from ..runs.checkpoint import DamagedCheckpoint
from ..runs.run import Run
from .arguments import Folder, PlaysRun, parse
from .console import err, print_warning


@dataclass
class Resume(PlaysRun):
    """Resume an interrupted training; it ends in the same tree as without the interruption."""

    run: Folder
    """The run's folder."""

    eval_episodes: int | None = None
    """Number of test episodes on Gymnasium at the end; by default as the training was started with."""

    env_workers: int = 0
    """Number of processes that step the copies of a Gymnasium environment; it may differ from before."""

    json: bool = False
    """Print only the summary, as one line of JSON."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol resume``."""
    given = parse(Resume, "resume", words)
    resumed = Run.open(given.run, given.env, trust=given.trust)
    return continue_run(resumed, given.eval_episodes, given.json, given.env_workers)


def continue_run(run: Run, eval_episodes: int | None, as_json: bool, env_workers: int = 0) -> int:
    """Resume a run from its last checkpoint; of a finished one, print the result and change nothing.

    Args:
        run: The run.
        eval_episodes: Number of test episodes at the end; by default as the training was started with.
        as_json: Whether to print only the summary, as JSON.
        env_workers: Number of processes that step the copies of the environment.

    Returns:
        The exit status.

    Raises:
        RunError: The run cannot be resumed.
    """
    from ..runs.metrics import SetAside
    from ..training import resume_agent
    from .learn import learn, show_result

    with run:
        if run.is_finished() and _is_trained(run):
            _print_finished(run, eval_episodes)
            show_result(run, run.load_summary() or {}, as_json)
            return 0
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", DamagedCheckpoint)
            warnings.simplefilter("always", SetAside)
            agent = resume_agent(run)
            agent.spec = agent.spec.stepped_by(env_workers) if env_workers else agent.spec
        for warning in caught:
            print_warning(warning.message)
        err.print(f"resuming at step {agent.num_timesteps:,} of {agent.config.total_timesteps:,}")
        tensorboard = (run.path / "tensorboard").is_dir()
        episodes = run.metadata["eval_episodes"] if eval_episodes is None else eval_episodes
        return learn(agent, run, episodes, as_json, tensorboard=tensorboard)


def _is_trained(run: Run) -> bool:
    """Return whether the newest whole checkpoint is that of the end of the training."""
    from ..agents import load_run

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedCheckpoint)
        agent = load_run(run)
    return agent.num_timesteps >= agent.config.total_timesteps


def _print_finished(run: Run, eval_episodes: int | None) -> None:
    summary = run.load_summary() or {}
    err.print(f"{run.path} is finished, and nothing in it is changed", markup=False)
    if eval_episodes not in (None, summary.get("episodes")):
        words = f"other test episodes: sympol eval {shlex.quote(str(run.path))} --episodes {eval_episodes}"
        err.print(words, markup=False)
