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
from .arguments import EnvKwargs, Text, env_kwargs, parse
from .console import err, out, print_steps, print_stopped, program

if TYPE_CHECKING:
    from ..search.front.front import Front

PICTURE = "front.svg"


@dataclass
class Pareto:
    """Search the best small trees of an environment: return against size, from which to choose.

    Trees are trained from scratch, distilled from a teacher and trained on, pruned by what they earn, and changed at
    random; those that no smaller tree is as good as are kept, chosen by validation episodes and then tested.
    Interrupted (Ctrl-C, a power cut), the same command goes on.

    Two minutes, at most 15 nodes: sympol pareto CartPole-v1 --budget 2m --max-nodes 15

    What training alone finds: sympol pareto CartPole-v1 --methods scratch
    """

    env: Text
    """Gymnasium id, such as CartPole-v1."""

    max_nodes: int = 63
    """Of the largest tree, splits and leaves counted: an odd number."""

    budget: str = ""
    """How long to search: a time (90s, 5m, 1h), or environment steps ("50M steps"), which give the same trees again on
    the same machine. By default 2m for CartPole-v1, 30m for LunarLander-v3, 10m for most others."""

    seed: int = 0
    """Of everything random."""

    methods: Annotated[
        tuple[Literal["scratch", "teacher", "evolve"], ...], tyro.conf.arg(aliases=["--roads"])
    ] = tuple(SHARES)  # pyright: ignore[reportAssignmentType]
    """What to try: scratch (trees trained by PPO), teacher (an MLP, distilled, pruned, polished), evolve (changes
    at random of whatever the others found, or of random trees)."""

    teacher: str = ""
    """A run's folder or a stable-baselines3 zip to distil, in place of an MLP that is trained for it."""

    trainings: int = 2
    """From scratch, seeds of their own."""

    teachers: int | None = None
    """Trained, or distillations of the one that is given, seeds of their own. By default 4 for LunarLander-v3, 2 for
    others."""

    islands: int = 2
    """Searches by evolution, seeds of their own."""

    eval_episodes: int = 100
    """Test episodes on Gymnasium of each tree of the front, by which nothing is chosen."""

    env_kwargs: EnvKwargs = ()
    """What to make the environment with, such as view_size=5."""

    workers: int = 0
    """Processes; by default one for each core, 2 at most."""

    out: Path | None = None
    """The front's folder; by default runs/ENV-front-SEED."""

    overwrite: bool = False
    """Search anew, whatever is in --out."""

    json: bool = False
    """Print one line of JSON and nothing else on the standard output."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol pareto``."""
    given = parse(Pareto, "pareto", words)

    from ..envs.registry import resolve
    from ..search.front.progress import LiveProgress
    from ..search.front.search import PLAN, begin, search

    if given.workers < 0:
        raise ValueError(f"--workers must be at least 1, or 0 for one a core, got {given.workers}")
    use_one_thread()
    plan = SearchConfig(
        env=given.env,
        env_kwargs=env_kwargs(given.env_kwargs),
        seed=given.seed,
        max_nodes=given.max_nodes,
        budget=given.budget,
        methods=given.methods,
        teacher=given.teacher,
        trainings=given.trainings,
        teachers=given.teachers,
        islands=given.islands,
        eval_episodes=given.eval_episodes,
    )
    if plan.teacher and not Path(plan.teacher).exists():
        raise RunError(
            f"there is no teacher {plan.teacher!r}; give a run's folder or the zip of a stable-baselines3 model"
        )
    spec = resolve(plan.env, env_kwargs=plan.env_kwargs)
    folder = given.out or Path("runs") / f"{file_name(spec.name)}-front-{given.seed}"
    if given.overwrite and (folder / PLAN).exists():
        with exclusive(folder, "search", "--out"):
            shutil.rmtree(folder)
    begin(plan, folder)
    err.print(
        f"searching trees of at most {plan.max_nodes} nodes for {spec.name}, {plan.budget}; in {folder}",
        markup=False,
    )
    try:
        with LiveProgress(plan, folder, err) as live:
            front = search(plan, folder, workers=given.workers or min(2, cores()), watch=live.watch)
    except KeyboardInterrupt:
        print_stopped(f"stopped; the same command goes on, as long as {shlex.quote(str(folder))} is there")
        return interrupts.status
    _show(front, folder, as_json=given.json)
    return 0


def _show(front: Front, folder: Path, *, as_json: bool) -> None:
    from ..search.front.files import fields_of, point_fields
    from ..search.front.plot import plot
    from ..search.front.tables import format_cost, next_steps, table

    picture = folder / PICTURE
    plot(front, picture)
    if as_json:
        points = [point_fields(point) for point in front.points]
        print(json.dumps({**fields_of(front), "points": points, "folder": str(folder)}))
        return
    out.print(table(front))
    out.print(f"\nall of it: {format_cost(front.cost)}", markup=False)
    print_steps([*next_steps(front, folder, program()), (str(picture), "the picture")])
