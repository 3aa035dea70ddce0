"""The commands behind `sympol.cli`."""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import io
import json
import shlex
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium
import tyro
from rich.console import Console
from rich.markup import escape

from . import STARTED
from .agents import PPO, Report, load
from .algos.config import ConfigError, PPOConfig
from .algos.presets import DEFAULT, preset
from .envs.host import EnvironmentFailure
from .envs.registry import Backend, UnknownEnvironment, resolve
from .evaluate import evaluate_policy, play
from .runs.checkpoint import DamagedCheckpoint
from .runs.folder import Run, RunError, versions
from .runs.metrics import TensorBoard

EVAL_SEED = 1
"""Of the test episodes at the end of a training; training and validation have streams of their own."""

out = Console(soft_wrap=True, highlight=False, emoji=False)
err = Console(stderr=True, soft_wrap=True, highlight=False, emoji=False)

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

    eval_episodes: int | None = None
    """Test episodes on Gymnasium at the end; by default as many as the training was told."""

    json: bool = False
    """One line of JSON."""


def train(arguments: Sequence[str]) -> int:
    """``sympol train``."""
    with _errors():
        given = _parse_train(arguments)
        if given.eval_episodes < 1:
            raise ValueError(f"--eval-episodes must be at least 1, got {given.eval_episodes}")
        if not given.env:
            raise ValueError("name an environment, as in: sympol train CartPole-v1")
        spec = resolve(given.env, backend=given.backend)
        agent = PPO("tree", spec, seed=given.seed, **dataclasses.asdict(given.config))
        if given.resume:
            return _continue(_same_run(given, agent), given.eval_episodes, given.json)
        if given.tensorboard:
            TensorBoard.require()
        path = given.run_dir or _next_free(Path("runs"), spec.name)
        run = Run.create(
            path,
            spec,
            agent.config,
            agent.seed,
            preset=given.preset,
            eval_episodes=given.eval_episodes,
            overwrite=given.overwrite or _ask(path),
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
                f"{escape(spec.name)}: return [bold]{mean:,.2f}[/] ± {std:,.2f} over {given.episodes} episodes "
                f"(seed {given.seed})"
            )
        return 0
    return 2


def show(arguments: Sequence[str]) -> int:
    """``sympol show``."""
    with _errors():
        given = _parse(Show, "show", arguments)
        run = Run.open(given.run)
        tree, summary = run.load_tree(), run.load_summary()
        try:
            words = "" if summary is None else _summary_words(summary)
        except (KeyError, TypeError, ValueError) as error:
            raise RunError(f"{run.path / 'summary.json'} is not a run's summary: {error!r}") from error
        out.print(tree.to_text(), markup=False)
        if words:
            out.print(words)
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
        err.print(f"written to {path}", markup=False)
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
        _print_error(error)
        raise SystemExit(2) from None
    except (EnvironmentFailure, ImportError, gymnasium.error.Error, OSError) as error:
        _print_error(error)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        err.print("interrupted")
        raise SystemExit(130) from None


def _print_error(error: BaseException) -> None:
    err.print(f"[bold red]error:[/] {escape(' '.join(str(error).split()))}")


def _parse(kind: type[Any], command: str, arguments: Sequence[str], default: Any = None) -> Any:
    """Arguments as ``kind``; what is wrong with them in one line."""
    options = {} if default is None else {"default": default}
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            parsed, unknown = tyro.cli(
                kind,
                args=list(arguments),
                prog=f"sympol {command}",
                config=(tyro.conf.OmitArgPrefixes,),
                return_unknown_args=True,
                **options,
            )
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        raise ValueError(f"{_first_box(said.getvalue())} (see sympol {command} --help)") from None
    if unknown:
        flags = [f"--{f.name}".replace("_", "-") for k in (kind, PPOConfig) for f in dataclasses.fields(k)]
        near = difflib.get_close_matches(unknown[0].replace("_", "-"), flags if kind is Train else flags[:9])
        hint = f"did you mean {' or '.join(near)}?" if near else f"see sympol {command} --help"
        raise ValueError(f"unknown argument {unknown[0]!r}; {hint}")
    return parsed


def _first_box(text: str) -> str:
    """What tyro draws as a box, its first paragraph, as a line."""
    lines = [line.strip("│ ") for line in text.splitlines() if line.startswith("│")]
    paragraph = lines[: next((i for i, line in enumerate(lines) if set(line) == {"─"}), len(lines))]
    return " ".join(paragraph).rstrip(".") or " ".join(text.split())


def _parse_train(arguments: Sequence[str]) -> Train:
    """In two passes: the first finds environment and preset, from which the flags not given take their values."""
    asks = {"-h", "--help"} & set(arguments)
    first: Train = Train("", config=PPOConfig())
    with contextlib.suppress(ValueError):  # the second pass says it
        first = _parse(Train, "train", [a for a in arguments if a not in asks], first)
    values = preset(first.env, first.preset)
    return _parse(Train, "train", arguments, Train("", config=PPOConfig.from_dict(values)))


def _same_run(given: Train, agent: PPO) -> Path:
    """The folder to go on in, where what was given does not contradict it."""
    if given.run_dir is None or given.overwrite:
        raise RunError("--resume needs the folder to go on in, as --run-dir, and cannot go with --overwrite")
    run = Run.open(given.run_dir)
    was = {"env": run.about["env"], "seed": run.seed, **run.config.to_dict()}
    now = {"env": agent.spec.name, "seed": agent.seed, **agent.config.to_dict()}
    changed = [f"{name} {was[name]}, not {now[name]}" for name in was if was[name] != now[name]]
    if changed:
        raise RunError(
            f"{run.path} was begun with {', '.join(changed)}; to go on with it as it was: sympol resume {run.path}"
        )
    return given.run_dir


def _next_free(folder: Path, name: str) -> Path:
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    number = 1
    while True:
        path = folder / f"{safe}-{number}"
        try:
            path.mkdir(parents=True)  # taken, whoever else is looking for one
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


def _continue(path: Path, eval_episodes: int | None, as_json: bool) -> int:
    run = Run.open(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DamagedCheckpoint)
        agent = load(path)
    for warning in caught:
        err.print(f"[bold yellow]warning:[/] {escape(' '.join(str(warning.message).split()))}")
    run.metrics.forget_after(agent.num_timesteps)
    err.print(f"resuming at step {agent.num_timesteps:,} of {agent.config.total_timesteps:,}")
    tensorboard = (run.path / "tensorboard").is_dir()
    episodes = run.about["eval_episodes"] if eval_episodes is None else eval_episodes
    return _learn(agent, run, episodes, as_json, tensorboard=tensorboard)


def _learn(agent: PPO, run: Run, eval_episodes: int, as_json: bool, *, tensorboard: bool = False) -> int:
    board = TensorBoard(run.path / "tensorboard") if tensorboard else None
    err.print(
        f"training a tree of depth {agent.config.depth} on {agent.spec.name}, seed {agent.seed}, "
        f"{'inside one compiled program' if agent.spec.env is not None else 'through Gymnasium'}; run: {run.path}",
        markup=False,
    )

    def keep(report: Report) -> bool:
        run.metrics.append(report.metrics)
        if board is not None:
            board.append(report.metrics)
        assert agent.state is not None
        run.save_checkpoint(agent.state)  # after its row: resuming drops rows that have no checkpoint
        return not asked.is_set()

    # the picture at the end needs a second of imports, which the compiler leaves time for
    threading.Thread(target=import_module, args=("matplotlib.backends.backend_svg",), daemon=True).start()
    first, began = agent.num_timesteps, time.perf_counter()
    try:
        with _ask_to_stop(lambda: agent.state is not None) as asked:
            if agent.num_timesteps < agent.config.total_timesteps:
                agent.learn(callback=keep)
        if agent.num_timesteps < agent.config.total_timesteps:
            raise KeyboardInterrupt
        seconds = time.perf_counter() - began
        summary = _finish(agent, run, eval_episodes)
    except (KeyboardInterrupt, EnvironmentFailure) as stop:
        return _stopped(agent, run, stop)
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
    if as_json:
        print(json.dumps(summary))
    else:
        out.print(run.load_tree().to_text(), markup=False)
        out.print(_summary_words(summary))
        _print_next(run.path)
    return 0


def _stopped(agent: PPO, run: Run, stop: BaseException) -> int:
    """Keep what there is and say how to go on."""
    if isinstance(stop, EnvironmentFailure):
        _print_error(stop)
        if agent.state is not None:
            run.save_checkpoint(agent.state)  # what the failed segment had come to
    at = f"saved at step {agent.num_timesteps:,}" if agent.state is not None else "nothing is trained yet"
    err.print(f"{at}; go on with: sympol resume {shlex.quote(str(run.path))}", markup=False)
    return 130 if isinstance(stop, KeyboardInterrupt) else 1


@contextlib.contextmanager
def _ask_to_stop(has_begun: Callable[[], bool]) -> Iterator[threading.Event]:
    """Let Ctrl-C wait for the next save, so that a resumed run ends as one never stopped; a second does not wait."""
    asked = threading.Event()

    def stop(number: int, frame: object) -> None:
        if asked.is_set() or not has_begun():
            raise KeyboardInterrupt
        asked.set()
        err.print("\nstopping at the next save; Ctrl-C again stops at once")

    if threading.current_thread() is not threading.main_thread():
        yield asked
        return
    before = signal.signal(signal.SIGINT, stop)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)


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
        try:
            episodes = play(tree, agent.spec, eval_episodes, seed=EVAL_SEED)
            sampled = play(full, agent.spec, eval_episodes, seed=EVAL_SEED, deterministic=False)
        except Exception as error:
            raise EnvironmentFailure(
                f"in the test episodes, after training: {type(error).__name__}: {error}"
            ) from error
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


def _summary_words(summary: dict[str, Any]) -> str:
    """What a run earned, its size and its time; everything put in is a number."""
    lines = [""]
    if "return_mean" in summary:
        lines.append(
            f"return   [bold]{summary['return_mean']:,.1f}[/] ± {summary['return_std']:,.1f} over "
            f"{summary['episodes']:,} test episodes on Gymnasium (sampling its actions: "
            f"{summary['sampled_return_mean']:,.1f})"
        )
    lines.append(
        f"size     [bold]{summary['nodes']:,}[/] nodes, {summary['leaves']:,} leaves, depth {summary['depth']:,} "
        f"(before pruning {summary['nodes_unpruned']:,} nodes)"
    )
    if "training_seconds" in summary:
        lines.append(
            f"time     {summary['wall_seconds']:.1f} s in all: {summary['compile_seconds']:.1f} s compiling, "
            f"{summary['training_seconds']:.1f} s training at {summary['steps_per_second']:,} steps/s"
        )
    return "\n".join(lines)


def _print_next(path: Path) -> None:
    out.print()
    run = shlex.quote(str(path))
    for command, what in (
        (f"sympol show {run}", "this tree again"),
        (f"sympol eval {run} --episodes 100 --seed 7", "more test episodes"),
        (f"sympol export {run} --to python", "the policy as a program without dependencies"),
    ):
        out.print(f"  {command:<55} {what}", style="dim", markup=False)
    out.print(f"  {path / 'tree.svg'!s:<55} the picture", style="dim", markup=False)
