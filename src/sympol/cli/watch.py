"""``sympol watch``: a film of test episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.markup import escape

from ..runs.metadata import RunError
from ..runs.run import Run
from .arguments import Folder, PlaysRun, parse
from .console import err, out

FILE = "episode.gif"
"""GIFs open everywhere. A tree and an environment have few colours, so that 256 are enough."""


@dataclass
class Watch(PlaysRun):
    """Film test episodes on Gymnasium: the environment, and beside it the tree with its path highlighted."""

    run: Folder
    """The run's folder."""

    episodes: int = 1
    """Number of episodes, one after another."""

    seed: int = 7
    """Seed of the episodes, which are those of sympol eval."""

    out: Path | None = None
    """The file: .gif, .webp, or .mp4; RUN/episode.gif by default."""

    fps: float | None = None
    """Steps per second; by default the environment's own pace, slower for short episodes."""

    max_steps: int | None = None
    """Cut episodes after this number of steps."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol watch``."""
    given = parse(Watch, "watch", words)
    played = Run.open(given.run, given.env, trust=given.trust)

    from ..evaluate import watch
    from ..report import policy_of

    policy, spec, path = policy_of(played), played.resolve_env(), given.out or played.path / FILE
    try:
        with err.status("") as status:
            film = watch(
                policy,
                spec,
                path,
                episodes=given.episodes,
                seed=given.seed,
                fps=given.fps,
                max_steps=given.max_steps,
                progress=lambda words: status.update(escape(words)),
            )
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror or error}; choose another --out") from error
    for earned, steps in zip(film.returns, film.lengths, strict=True):
        out.print(
            f"{escape(spec.name)}: return [bold]{earned:,.2f}[/] in {steps:,} steps (seed {given.seed})"
        )
    every = f", every {film.stride} steps" if film.stride > 1 else ""
    err.print(f"written to {film.path} ({film.frames} frames{every}, {film.size / 1e6:.1f} MB)", markup=False)
    return 0
