"""The commands that train, train and resume: which agent learns, and in which folder."""

from __future__ import annotations

import shlex
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from ..agents import Agent, agent_of, load_run
from ..algorithms.config import SIZE_LIMITS
from ..algorithms.memory import require_memory
from ..envs.registry import resolve
from ..runs.checkpoint import DamagedCheckpoint
from ..runs.metadata import RunError, file_name
from ..runs.metrics import SetAside, TensorBoard
from ..runs.run import Run
from ..training import go_on
from .arguments import Resume, Train
from .console import err, one_line_errors, print_warning
from .learn import learn, show_result
from .parse import env_kwargs, parse, parse_train
from .warm_start_args import start_from


@one_line_errors()
def train(arguments: Sequence[str]) -> int:
    """``sympol train``."""
    given = parse_train(arguments)
    if given.eval_episodes < 1:
        raise ValueError(f"--eval-episodes must be at least 1, got {given.eval_episodes}")
    if not given.env:
        raise ValueError("name an environment, as in: sympol train CartPole-v1")
    spec = resolve(given.env, env_kwargs=env_kwargs(given.env_kwargs), backend=given.backend)
    agent = agent_of(spec, given.config, given.seed, start_from(given, spec))
    if given.resume:
        return _continue(_same_run(given, agent), given.eval_episodes, given.json)
    if given.tensorboard:
        TensorBoard.require()
    require_memory(spec, agent.config)
    path = given.run_dir or _next_free(Path("runs"), spec.name)
    with Run.create(
        path,
        spec,
        agent.config,
        agent.seed,
        preset=given.preset,
        eval_episodes=given.eval_episodes,
        overwrite=given.overwrite or _ask(path),
        start=agent.start,
    ) as run:
        return learn(agent, run, given.eval_episodes, given.json, tensorboard=given.tensorboard)


@one_line_errors()
def resume(arguments: Sequence[str]) -> int:
    """``sympol resume``."""
    given = parse(Resume, "resume", arguments)
    run = Run.open(given.run, given.env, trust=given.trust)
    return _continue(run, given.eval_episodes, given.json)


def _same_run(given: Train, agent: Agent) -> Run:
    """The run to resume, where what was given does not contradict it."""
    if given.run_dir is None or given.overwrite:
        raise RunError("--resume needs the folder to go on in, as --run-dir, and cannot go with --overwrite")
    run = Run.open(given.run_dir)
    about = run.metadata
    made = agent.spec.origin.to_dict()
    was = {
        "env": about["env"],
        **{name: about[name] for name in made},
        "seed": run.seed,
        **run.config.to_dict(),
    }
    spec = agent.spec
    now = {"env": spec.name, **made, "seed": agent.seed, **agent.config.to_dict()}
    begun, begins = run.load_start(), agent.start
    was["start"], now["start"] = (None if start is None else start.about() for start in (begun, begins))
    for config, said in ((run.config, was), (agent.config, now)):
        said.update(
            {name: getattr(config, name) for name in SIZE_LIMITS}
        )  # which are not written where there are none
    changed = [f"{name} {was[name]}, not {now[name]}" for name in was if was[name] != now[name]]
    if begun is not None and begins is not None and begun.tree != begins.tree:
        changed.append(f"another tree in {begins.origin}")
    if changed:
        raise RunError(
            f"{run.path} was begun with {', '.join(changed)}; to go on with it as it was: sympol resume "
            f"{run.as_argument}"
        )
    return run


def _continue(run: Run, eval_episodes: int | None, as_json: bool) -> int:
    """Resume from the last checkpoint; where the training is finished, show what came of it and change nothing."""
    with run:
        if run.is_finished() and _is_trained(run):
            _show_finished(run, eval_episodes, as_json)
            return 0
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", DamagedCheckpoint)
            warnings.simplefilter("always", SetAside)
            agent = go_on(run)
        for warning in caught:
            print_warning(warning.message)
        err.print(f"resuming at step {agent.num_timesteps:,} of {agent.config.total_timesteps:,}")
        tensorboard = (run.path / "tensorboard").is_dir()
        episodes = run.metadata["eval_episodes"] if eval_episodes is None else eval_episodes
        return learn(agent, run, episodes, as_json, tensorboard=tensorboard)


def _is_trained(run: Run) -> bool:
    """Whether its newest checkpoint is whole, and that of the end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedCheckpoint)
        agent = load_run(run)
    return agent.num_timesteps >= agent.config.total_timesteps


def _show_finished(run: Run, eval_episodes: int | None, as_json: bool) -> None:
    summary = run.load_summary() or {}
    err.print(f"{run.path} is finished, and nothing in it is changed", markup=False)
    if eval_episodes not in (None, summary.get("episodes")):
        words = f"other test episodes: sympol eval {shlex.quote(str(run.path))} --episodes {eval_episodes}"
        err.print(words, markup=False)
    show_result(run, summary, as_json)


def _next_free(folder: Path, name: str) -> Path:
    """``name`` and the first number that nobody has, made at once so that nobody else takes it."""
    number = 1
    while True:
        path = folder / f"{file_name(name)}-{number}"
        try:
            path.mkdir(parents=True)
            return path
        except FileExistsError as error:
            if folder.exists() and not folder.is_dir():
                raise RunError(f"{folder} is a file; choose a --run-dir") from error
            number += 1
        except OSError as error:
            raise RunError(f"cannot write {path}: {error.strerror}; choose another --run-dir") from error


def _ask(path: Path) -> bool:
    """Whether a run that is there may be replaced: only a person at a terminal can say so."""
    if not (path / "config.toml").exists() or not sys.stdin.isatty() or not sys.stderr.isatty():
        return False
    err.print(f"{path} already holds a run. Replace it? [y/N] ", markup=False, end="")
    return input().strip().lower() in ("y", "yes")
