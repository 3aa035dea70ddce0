"""A training of a run to its end: learn, save, stop on request, test, summarise."""

from __future__ import annotations

import contextlib
import json
import signal
import threading
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

from .. import STARTED, files
from ..agents import Agent, Report
from ..algorithms.config import Config
from ..envs.errors import EnvironmentFailure
from ..envs.spec import EnvSpec
from ..interrupts import interrupts, say
from ..play import Episodes, play
from ..runs.metrics import TensorBoard
from ..runs.run import Run
from ..training import finish, save_into
from .console import err, out, print_error, print_stopped
from .summary import format_summary, print_next, with_teacher

EVAL_SEED = 1
"""Seed of the test episodes at the end of a training, from which training and validation seeds differ."""


def learn(agent: Agent, run: Run, eval_episodes: int, as_json: bool, *, tensorboard: bool) -> int:
    """Train an agent to the end, save everything in its run, and print the summary.

    Args:
        agent: The agent, new or resumed.
        run: Its run, which this process has locked.
        eval_episodes: Number of test episodes at the end.
        as_json: Whether to print only the summary, as JSON.
        tensorboard: Whether to write TensorBoard logs.

    Returns:
        The exit status.
    """
    board = TensorBoard(run.path / "tensorboard") if tensorboard else None
    err.print(
        f"training {_what(agent)} on {agent.spec.name}, seed {agent.seed}, {_through(agent.spec)}; run: {run.path}",
        markup=False,
    )

    # the picture at the end needs a second of imports: time enough for them while the compiled program runs
    picture = threading.Thread(target=import_module, args=("matplotlib.backends.backend_svg",), daemon=True)

    saved = _Saved(run, agent.num_timesteps)

    def has_begun() -> bool:
        return agent.is_training and agent.state is not None

    def still_wanted(report: Report) -> None:
        interrupts.check()  # an environment that caught the second Ctrl-C has not stepped as it should

    def watch(report: Report) -> bool:
        saved.step = report.timestep
        if picture.ident is None:
            picture.start()
        if board is not None:
            with run.writing():
                board.append(report.metrics)
        return not asked.is_set()

    first, began = agent.num_timesteps, time.perf_counter()
    try:
        with _ask_to_stop(has_begun, saved.words) as asked:
            if agent.num_timesteps < agent.config.total_timesteps:
                agent.learn(callback=[still_wanted, save_into(run), watch])
        if asked.is_set():
            raise KeyboardInterrupt
        seconds = time.perf_counter() - began
        summary = finish(agent, run, *_test(agent, eval_episodes), EVAL_SEED)
    except (KeyboardInterrupt, EnvironmentFailure) as stop:
        return _stopped(agent, saved, stop)
    finally:
        if board is not None:
            board.close()
    trained = max(1e-9, seconds - agent.compile_seconds)
    summary |= {
        "wall_seconds": round(time.perf_counter() - STARTED, 3),
        "compile_seconds": round(agent.compile_seconds, 3),
        "training_seconds": round(trained, 3),
        "steps_per_second": round((agent.num_timesteps - first) / trained),
    }
    run.save_summary(summary)
    show_result(run, summary, as_json)
    return 0


def show_result(run: Run, summary: dict[str, Any], as_json: bool) -> None:
    """Print the tree and the summary of a finished run."""
    if as_json:
        print(json.dumps(summary))
        return
    if (run.path / "tree.txt").is_file():
        out.print(files.read_text(run.path / "tree.txt").rstrip("\n"), markup=False)
    out.print(format_summary(run, summary))
    print_next(run)


def _what(agent: Agent) -> str:
    config = agent.config
    begun = "" if agent.start is None else f" from {agent.start.origin}"
    hidden = " × ".join(str(width) for width in config.actor_hidden)
    return {
        "tree": f"a tree of depth {config.depth}{_limit(config)}{begun}{with_teacher(config)}",
        "sdt": f"a soft tree of depth {config.depth}",
        "mlp": f"an MLP ({hidden})",
    }[config.policy]


def _limit(config: Config) -> str:
    """Return the size limits as text."""
    most = f", at most {config.max_nodes:,} nodes" if config.max_nodes else ""
    return most + (f", a return of {config.node_price:g} a node" if config.node_price else "")


def _through(spec: EnvSpec) -> str:
    if spec.speed_hint:
        return f"through Gymnasium ({spec.speed_hint})"
    return {"jax": "inside one compiled program", "native": "in machine code"}.get(
        spec.backend, "through Gymnasium"
    )


class _Saved:
    """The last saved step, and the line to end with if the training stops early."""

    def __init__(self, run: Run, step: int) -> None:
        self.run, self.step = run, step

    def words(self) -> str:
        at = f"saved at step {self.step:,}" if self.step else "nothing is trained yet"
        return f"{at}; resume with: sympol resume {self.run.as_argument}"


@contextlib.contextmanager
def _ask_to_stop(
    has_begun: Callable[[], bool], words: Callable[[], str] | None = None
) -> Iterator[threading.Event]:
    """Let Ctrl-C or SIGTERM wait for the next save, so that a resumed run ends as one never stopped.

    Where there is nothing to save yet they do not wait, nor does a second Ctrl-C. A second SIGTERM says nothing new:
    some programs send two at once (`timeout`).
    """
    asked = threading.Event()

    def decide(number: int) -> bool:
        again = asked.is_set()
        asked.set()  # first of all: what is raised now may be lost
        if not has_begun():
            return True
        if not again:
            say("\nstopping at the next save; Ctrl-C again stops at once")
        return again and number == signal.SIGINT

    with interrupts.heard(decide, terms=True, words=words):
        yield asked


def _test(agent: Agent, eval_episodes: int) -> tuple[Episodes, Episodes]:
    """Play test episodes with deterministic actions, and others with sampled ones."""
    policy = agent.tree() if agent.has_tree else agent
    try:
        episodes = play(policy, agent.spec, eval_episodes, seed=EVAL_SEED)
        return episodes, play(agent, agent.spec, eval_episodes, seed=EVAL_SEED, deterministic=False)
    except Exception as error:
        raise EnvironmentFailure(
            f"in the test episodes, after training: {type(error).__name__}: {error}"
        ) from error


def _stopped(agent: Agent, saved: _Saved, stop: BaseException) -> int:
    """Save the state, and print how to resume."""
    if isinstance(stop, KeyboardInterrupt) or interrupts.at_once:
        print_stopped(saved.words())
        return interrupts.status
    print_error(stop)
    if agent.state is not None:
        saved.run.save_checkpoint(agent.state)  # what the failed segment had come to
        saved.step = agent.num_timesteps
    err.print(saved.words(), markup=False)
    return 1
