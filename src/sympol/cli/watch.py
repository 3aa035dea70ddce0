"""The command that makes a film, watch."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape

from ..evaluate import watch as make_film
from ..report import policy_of
from ..runs.metadata import RunError
from ..runs.run import Run
from .arguments import Watch
from .console import err, one_line_errors, out
from .parse import parse

FILE = "episode.gif"
"""Of the three formats the one that opens everywhere: browsers, mail, slides, GitHub, picture viewers. A tree and
an environment have few colours, so that it loses little by having 256."""


@one_line_errors()
def watch(arguments: Sequence[str]) -> int:
    """``sympol watch``."""
    given = parse(Watch, "watch", arguments)
    run = Run.open(given.run, given.env, trust=given.trust)
    policy, spec, path = policy_of(run), run.resolve_env(), given.out or run.path / FILE
    try:
        with err.status("") as status:
            film = make_film(
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
