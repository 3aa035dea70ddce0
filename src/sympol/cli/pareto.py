"""``sympol pareto``: a search for the best small trees."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from ..interrupts import interrupts
from ..runs.lock import exclusive
from ..runs.metadata import RunError, file_name
from ..search.front.config import SHARES, SearchConfig
from ..threads import cores, use_one_thread
from .arguments import EnvKwargs, MaxRules, Text, env_kwargs, parse
from .console import err, out, print_steps, print_stopped, program

if TYPE_CHECKING:
    from ..search.front.front import Front

PICTURE = "front.svg"


@dataclass
class Pareto:
    """Search the best small trees of an environment: return against size, from which to choose.

    Trees are trained from scratch, distilled from a teacher and fine-tuned, pruned by return, and mutated at random.
    The front holds each tree that earns more than all smaller ones, chosen by validation episodes and then tested.
    If the search is interrupted (Ctrl-C, a power cut), the same command resumes it.

    Two minutes, at most 15 nodes: sympol pareto CartPole-v1 --budget 2m --max-nodes 15

    Only training: sympol pareto CartPole-v1 --methods scratch
    """

    env: Text
    """Gymnasium id, such as CartPole-v1, or file.py:Name or module:Name."""

    max_nodes: int = 63
    """Splits and leaves of the largest tree together: an odd number."""

    max_rules: MaxRules = None
    """Leaves of the largest tree, in place of --max-nodes: a tree of N rules has 2 N - 1 nodes."""

    budget: str = ""
    """How long to search: a time (90s, 5m, 1h), or environment steps ("50M steps"), which give the same trees again on
    the same machine. Trainings, fine-tuning and evolution end with the budget; distillation, pruning and selection
    are always finished, and of a small budget in steps they take many times as much. By default 2m for CartPole-v1,
    30m for LunarLander-v3, 10m for most others."""

    seed: int = 0
    """Seed of everything random."""

    methods: Annotated[
        tuple[Literal["scratch", "teacher", "evolve"], ...], tyro.conf.arg(aliases=["--roads"])
    ] = tuple(SHARES)  # pyright: ignore[reportAssignmentType]
    """Methods to use: scratch (trees trained by PPO), teacher (an MLP, distilled, pruned, fine-tuned), evolve (random
    mutations of the trees of the others, or of random trees)."""

    teacher: str = ""
    """A run's folder or a stable-baselines3 zip to distil, in place of an MLP that is trained for it."""

    trainings: int = 2
    """Trainings from scratch, with different seeds."""

    teachers: int | None = None
    """Teachers, or distillations of the one that is given, with different seeds. By default 4 for LunarLander-v3, 2
    for others."""

    islands: int = 2
    """Searches by evolution, with different seeds."""

    eval_episodes: int = 100
    """Test episodes on Gymnasium of each tree of the front, by which nothing is chosen."""

    env_kwargs: EnvKwargs = ()
    """Arguments of the environment, such as view_size=5."""

    workers: int = 0
    """Processes; by default one for each core, 2 at most."""

    out: Path | None = None
    """The front's folder; by default runs/ENV-front-SEED."""

    overwrite: bool = False
    """Replace the search in --out."""

    json: bool = False
    """Print one line of JSON and nothing else on the standard output."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol pareto``.

    Args:
        words: The arguments of the command.

    Returns:
        The exit status.

    Raises:
        ValueError, RunError: An argument that makes no search, or a folder that holds something else.
    """
    args = parse(Pareto, "pareto", words)

    from ..envs.registry import resolve
    from ..search.front.formatting import LiveProgress
    from ..search.front.search import CONFIG, begin, search

    if args.workers < 0:
        raise ValueError(f"--workers must be at least 1, or 0 for one a core, got {args.workers}")
    use_one_thread()
    config = SearchConfig(
        env=args.env,
        env_kwargs=env_kwargs(args.env_kwargs),
        seed=args.seed,
        max_nodes=args.max_nodes,
        budget=args.budget,
        methods=args.methods,
        teacher=args.teacher,
        trainings=args.trainings,
        teachers=args.teachers,
        islands=args.islands,
        eval_episodes=args.eval_episodes,
    )
    if config.teacher and not Path(config.teacher).exists():
        raise RunError(
            f"there is no teacher {config.teacher!r}; give a run's folder or the zip of a stable-baselines3 model"
        )
    spec = resolve(config.env, env_kwargs=config.env_kwargs)
    folder = args.out or Path("runs") / f"{file_name(spec.short_name)}-front-{args.seed}"
    if args.overwrite and (folder / CONFIG).exists():
        with exclusive(folder, "search", "--out"):
            shutil.rmtree(folder)
    begin(config, folder)
    err.print(
        f"searching trees of at most {config.max_nodes} nodes for {spec.name}, {config.budget}; in {folder}",
        markup=False,
    )
    try:
        with LiveProgress(config, folder, err) as progress:
            front = search(config, folder, workers=args.workers or min(2, cores()), watch=progress.watch)
    except KeyboardInterrupt:
        print_stopped(f"stopped; the same command resumes the search in {shlex.quote(str(folder))}")
        return interrupts.status
    _show(front, folder, as_json=args.json)
    return 0


def _show(front: Front, folder: Path, *, as_json: bool) -> None:
    from ..search.front.files import fields_of, point_fields
    from ..search.front.formatting import format_cost, format_excess, next_steps, table
    from ..search.front.plot import plot

    picture = folder / PICTURE
    plot(front, picture)
    if as_json:
        points = [point_fields(point) for point in front.points]
        print(json.dumps({**fields_of(front), "points": points, "folder": str(folder)}))
        return
    out.print(table(front))
    out.print(f"\nwhole search: {format_cost(front.cost)}", markup=False)
    if excess := format_excess(front):
        out.print(excess, markup=False)
    print_steps([*next_steps(front, folder, program()), (str(picture), "the picture")])
