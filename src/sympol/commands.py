"""The commands behind `sympol.cli`."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from .agents import PPO, Report, load
from .algos.config import ConfigError, PPOConfig
from .algos.presets import DEFAULT, preset, presets_of
from .envs.host import EnvironmentFailure
from .envs.registry import Backend, UnknownEnvironment, resolve
from .evaluate import evaluate_policy, play
from .runs.folder import Run, RunError, versions
from .runs.metrics import TensorBoard
from .trees import DecisionTree

START = time.perf_counter()
EVAL_SEED = 1
"""Of the test episodes at the end of a training; training and validation have streams of their own."""

out = Console(soft_wrap=True, highlight=False)
err = Console(stderr=True, soft_wrap=True, highlight=False)

Text = tyro.conf.Positional[str]
Folder = tyro.conf.Positional[Path]


@dataclass
class Train:
    """Train a decision tree by PPO and keep everything in one folder."""

    env: Text
    """Gymnasium id, such as CartPole-v1."""

    seed: int = 0
    """Of everything random; the same seed on the same machine gives the same tree."""

    preset: str = DEFAULT
    """Where the hyperparameters come from: default (ours) or paper."""

    run_dir: Path | None = None
    """The run's folder; by default the next free one under runs/."""

    overwrite: bool = False
    """Replace the run that is in --run-dir."""

    resume: bool = False
    """Go on with the run that is in --run-dir."""

    backend: Backend = "auto"
    """jax: inside the compiled program; host: through Gymnasium; auto: jax where there is one."""

    eval_episodes: int = 20
    """Test episodes on Gymnasium at the end."""

    tensorboard: bool = False
    """Write TensorBoard logs into the run, too."""

    json: bool = False
    """Print the summary as one line of JSON and nothing else on the standard output."""

    config: Annotated[PPOConfig, tyro.conf.arg(name="")] = field(default_factory=PPOConfig)


@dataclass
class Eval:
    """Play test episodes with a run's tree, on Gymnasium itself."""

    run: Folder
    """The run's folder."""

    episodes: int = 100
    """How many."""

    seed: int = 7
    """Another seed, other episodes."""

    json: bool = False
    """One line of JSON."""


@dataclass
class Show:
    """The tree of a run, as text, and what it earns."""

    run: Folder
    """The run's folder."""


@dataclass
class Export:
    """The tree of a run as a program, a document or a picture."""

    run: Folder
    """The run's folder."""

    to: Literal["python", "json", "text", "svg", "pdf", "png"] = "python"
    """What to write."""

    out: Path | None = None
    """Where to; the standard output by default, for pictures RUN/tree.<format>."""


@dataclass
class Resume:
    """Go on with an interrupted training; it ends in the tree it would have ended in."""

    run: Folder
    """The run's folder."""

    eval_episodes: int = 20
    """Test episodes on Gymnasium at the end."""

    json: bool = False
    """One line of JSON."""


def train(arguments: Sequence[str]) -> int:
    """``sympol train``."""
    with _errors():
        given = _parse(Train, "train", arguments, Train("", config=_preset_config(arguments)))
        spec = resolve(given.env, backend=given.backend)
        agent = PPO("tree", spec, seed=given.seed, **dataclasses.asdict(given.config))
        path = given.run_dir or _next_free(Path("runs"), spec.name)
        if given.resume:
            return _continue(path, given.eval_episodes, given.json)
        run = Run.create(
            path, spec, agent.config, agent.seed, preset=given.preset, overwrite=given.overwrite or _ask(path)
        )
        return _learn(agent, run, given.eval_episodes, given.json, tensorboard=given.tensorboard)
    return 2


def resume(arguments: Sequence[str]) -> int:
    """``sympol resume``."""
    with _errors():
        given = _parse(Resume, "resume", arguments)
        return _continue(given.run, given.eval_episodes, given.json)
    return 2


def evaluate(arguments: Sequence[str]) -> int:
    """``sympol eval``."""
    with _errors():
        given = _parse(Eval, "eval", arguments)
        run = Run.open(given.run)
        spec = run.resolve_env()
        mean, std = evaluate_policy(run.load_tree(), spec, given.episodes, seed=given.seed)
        result = {
            "env": spec.name,
            "return_mean": mean,
            "return_std": std,
            "episodes": given.episodes,
            "eval_seed": given.seed,
        }
        if given.json:
            print(json.dumps(result))
        else:
            out.print(
                f"{spec.name}: return [bold]{mean:,.2f}[/] ± {std:,.2f} over {given.episodes} episodes "
                f"(seed {given.seed})"
            )
        return 0
    return 2


def show(arguments: Sequence[str]) -> int:
    """``sympol show``."""
    with _errors():
        given = _parse(Show, "show", arguments)
        run = Run.open(given.run)
        out.print(run.load_tree().to_text(), markup=False)
        summary = run.path / "summary.json"
        if summary.exists():
            _print_summary(json.loads(summary.read_text()))
        return 0
    return 2


def export(arguments: Sequence[str]) -> int:
    """``sympol export``."""
    with _errors():
        given = _parse(Export, "export", arguments)
        run = Run.open(given.run)
        tree = run.load_tree()
        texts: dict[str, Callable[[], str]] = {
            "python": tree.to_python,
            "json": tree.to_json,
            "text": tree.to_text,
        }
        if given.to in texts and given.out is None:
            print(texts[given.to]())
            return 0
        path = given.out or run.path / f"tree.{given.to}"
        try:
            if given.to in texts:
                path.write_text(texts[given.to]() + "\n", encoding="utf-8")
            else:
                tree.plot(path if path.suffix == f".{given.to}" else path.with_suffix(f".{given.to}"))
        except OSError as error:
            raise RunError(f"cannot write {path}: {error.strerror}; choose another --out") from error
        err.print(f"written to {path}")
        return 0
    return 2


COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train,
    "show": show,
    "eval": evaluate,
    "export": export,
    "resume": resume,
}


@contextlib.contextmanager
def _errors() -> Iterator[None]:
    """Bad input is one line on the error stream and status 2; so are failures, with status 1."""
    try:
        yield
    except (ConfigError, UnknownEnvironment, RunError, ValueError) as error:
        err.print(f"[bold red]error:[/] {_escape(str(error))}")
        raise SystemExit(2) from None
    except (EnvironmentFailure, ImportError) as error:
        err.print(f"[bold red]error:[/] {_escape(str(error))}")
        raise SystemExit(1) from None


def _escape(text: str) -> str:
    return text.replace("[", r"\[")


def _parse(kind: type[Any], command: str, arguments: Sequence[str], default: Any = None) -> Any:
    options = {} if default is None else {"default": default}
    return tyro.cli(
        kind, args=list(arguments), prog=f"sympol {command}", config=(tyro.conf.OmitArgPrefixes,), **options
    )


def _preset_config(arguments: Sequence[str]) -> PPOConfig:
    """What the flags fall back to: the preset of the environment that is named first."""
    words = [word for word in arguments if not word.startswith("-")]
    env = arguments[0] if arguments and not arguments[0].startswith("-") else next(iter(words), "")
    name = DEFAULT
    for i, word in enumerate(arguments):
        if word.startswith("--preset"):
            name = word.partition("=")[2] or (arguments[i + 1] if i + 1 < len(arguments) else DEFAULT)
    return PPOConfig.from_dict(preset(env, name)) if env in words and presets_of(env) else PPOConfig()


def _next_free(folder: Path, name: str) -> Path:
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    number = 1
    while (folder / f"{safe}-{number}").exists():
        number += 1
    return folder / f"{safe}-{number}"


def _ask(path: Path) -> bool:
    """Whether a run that is there may be replaced: only a person at a terminal can say so."""
    if not (path / "config.toml").exists() or not sys.stdin.isatty() or not sys.stderr.isatty():
        return False
    err.print(f"{path} already holds a run. Replace it? [y/N] ", markup=False, end="")
    return input().strip().lower() in ("y", "yes")


def _continue(path: Path, eval_episodes: int, as_json: bool) -> int:
    run = Run.open(path)
    agent = load(path)
    err.print(f"resuming at step {agent.num_timesteps:,} of {agent.config.total_timesteps:,}")
    return _learn(agent, run, eval_episodes, as_json)


def _learn(agent: PPO, run: Run, eval_episodes: int, as_json: bool, *, tensorboard: bool = False) -> int:
    board = TensorBoard(run.path / "tensorboard") if tensorboard else None
    err.print(
        f"training a tree of depth {agent.config.depth} on {agent.spec.name}, seed {agent.seed}, "
        f"{'inside one compiled program' if agent.spec.env is not None else 'through Gymnasium'}; run: {run.path}"
    )

    def keep(report: Report) -> None:
        run.metrics.append(report.metrics)
        if board is not None:
            board.append(report.metrics)
        assert agent.state is not None
        run.save_checkpoint(agent.state)

    first, began = agent.num_timesteps, time.perf_counter()
    try:
        if agent.num_timesteps < agent.config.total_timesteps:
            agent.learn(callback=keep)
    except (KeyboardInterrupt, EnvironmentFailure) as stop:
        return _stopped(agent, run, stop)
    seconds = time.perf_counter() - began
    summary = _finish(agent, run, eval_episodes)
    trained = max(1e-9, seconds - agent.compile_seconds)
    summary |= {
        "wall_seconds": round(time.perf_counter() - START, 3),
        "compile_seconds": round(agent.compile_seconds, 3),
        "training_seconds": round(trained, 3),
        "steps_per_second": round((agent.num_timesteps - first) / trained),
    }
    run.save_summary(summary)
    if as_json:
        print(json.dumps(summary))
    else:
        out.print(run.load_tree().to_text(), markup=False)
        _print_summary(summary)
        _print_next(run.path)
    return 0


def _stopped(agent: PPO, run: Run, stop: BaseException) -> int:
    """Keep what there is and say how to go on."""
    if agent.state is None:
        err.print("stopped before the first validation: nothing to keep yet")
    else:
        run.save_checkpoint(agent.state)
        err.print(f"saved at step {agent.num_timesteps:,}; go on with: sympol resume {run.path}")
    if isinstance(stop, KeyboardInterrupt):
        return 130
    err.print(f"[bold red]error:[/] {_escape(str(stop))}")
    return 1


def _finish(agent: PPO, run: Run, eval_episodes: int) -> dict[str, Any]:
    """Test the tree, count its visits, write it in every form."""
    full, tree = agent.tree(prune=False), agent.tree()
    state = agent.state
    assert state is not None
    summary: dict[str, Any] = {
        "env": agent.spec.name,
        "seed": agent.seed,
        "timesteps": agent.num_timesteps,
        "nodes": tree.n_nodes,
        "nodes_unpruned": full.n_nodes,
        "leaves": tree.n_leaves,
        "depth": tree.depth,
        "validation_return": float(state.validation.best_return),
        "best_timestep": int(state.validation.best_timestep),
    }
    if agent.spec.make_host is not None:
        episodes = play(tree, agent.spec, eval_episodes, seed=EVAL_SEED)
        sampled = play(full, agent.spec, eval_episodes, seed=EVAL_SEED, deterministic=False)
        tree = tree.with_visits(episodes.observations)
        summary |= {
            "return_mean": float(episodes.returns.mean()),
            "return_std": float(episodes.returns.std()),
            "sampled_return_mean": float(sampled.returns.mean()),
            "sampled_return_std": float(sampled.returns.std()),
            "episodes": eval_episodes,
            "eval_seed": EVAL_SEED,
        }
    run.save_tree(tree)
    return summary | {"preset": run.about["preset"], "run_dir": str(run.path), "versions": versions()}


def _print_summary(summary: dict[str, Any]) -> None:
    out.print()
    if "return_mean" in summary:
        out.print(
            f"return   [bold]{summary['return_mean']:,.1f}[/] ± {summary['return_std']:,.1f} over "
            f"{summary['episodes']} test episodes on Gymnasium (sampling its actions: "
            f"{summary['sampled_return_mean']:,.1f})"
        )
    out.print(
        f"size     [bold]{summary['nodes']}[/] nodes, {summary['leaves']} leaves, depth {summary['depth']} "
        f"(before pruning {summary['nodes_unpruned']} nodes)"
    )
    if "training_seconds" in summary:
        out.print(
            f"time     {summary['wall_seconds']:.1f} s in all: {summary['compile_seconds']:.1f} s compiling, "
            f"{summary['training_seconds']:.1f} s training at {summary['steps_per_second']:,} steps/s"
        )


def _print_next(path: Path) -> None:
    out.print()
    for command, what in (
        (f"sympol show {path}", "this tree again"),
        (f"sympol eval {path} --episodes 100 --seed 7", "more test episodes"),
        (f"sympol export {path} --to python", "the policy as a program without dependencies"),
    ):
        out.print(f"  {command:<55} {what}", style="dim", markup=False)
    out.print(f"  {path / 'tree.svg'!s:<55} the picture", style="dim", markup=False)
