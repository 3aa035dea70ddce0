"""``sympol eval``: test episodes of a run's policy."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

from rich.markup import escape

from ..runs.formatting import format_return
from ..runs.run import Run
from .arguments import Folder, PlaysRun, parse
from .console import out


@dataclass
class Eval(PlaysRun):
    """Play test episodes with a run's policy, on Gymnasium itself."""

    run: Folder
    """The run's folder."""

    episodes: int = 100
    """Number of episodes."""

    seed: int = 7
    """Seed of the episodes."""

    json: bool = False
    """Print one line of JSON."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol eval``."""
    given = parse(Eval, "eval", words)
    played = Run.open(given.run, given.env, trust=given.trust)

    from ..evaluate import evaluate_policy
    from ..report import policy_of

    spec = played.resolve_env()
    mean, std = evaluate_policy(policy_of(played), spec, given.episodes, seed=given.seed)
    if given.json:
        result = {
            "env": spec.name,
            "return_mean": mean,
            "return_std": std,
            "episodes": given.episodes,
            "eval_seed": given.seed,
        }
        print(json.dumps(result))
    else:
        out.print(
            f"{escape(spec.name)}: return [bold]{format_return(mean, std)}[/] over {given.episodes} episodes "
            f"(seed {given.seed})"
        )
    return 0
