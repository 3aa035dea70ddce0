"""The report of a search: its best trials, the importance of hyperparameters, plots, and the best trial as a preset."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from .. import files
from ..algorithms.presets import DEFAULT
from ..bounded import LARGEST_BY_HAND, parse_toml
from ..results.style import PANEL, legend_below, panels, save, style_of, styled
from .study import Search, finished, quiet, search_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from optuna import Study
    from optuna.trial import FrozenTrial

_FEW = 10
"""The number of completed trials below which importances mean nothing."""
_TOP = 5
"""The number of best trials that PED-ANOVA compares with the rest, or a tenth if that is more; fewer are unstable."""


def best_trials(study: Study) -> list[FrozenTrial]:
    """Return the completed trials, the best first, and of equal ones the earlier first."""
    from optuna.trial import TrialState

    completed = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    return sorted(completed, key=lambda trial: (-_value(trial), trial.number))


def counts(study: Study) -> dict[str, int]:
    """Return the numbers of completed, pruned and failed trials."""
    names = [trial.state.name.lower() for trial in finished(study)]
    return {name: names.count(name) for name in ("complete", "pruned", "fail")}


def importances(study: Study) -> dict[str, float]:
    """Return each hyperparameter's share in what distinguishes the best trials (PED-ANOVA); empty for few trials."""
    import optuna

    completed = best_trials(study)
    if len(completed) < _FEW or len({trial.value for trial in completed}) == 1:
        return {}
    with quiet():
        evaluator = optuna.importance.PedAnovaImportanceEvaluator(
            target_quantile=max(0.1, _TOP / len(completed))
        )
        return optuna.importance.get_param_importances(study, evaluator=evaluator)


def write_plots(study: Study, stem: Path) -> list[Path]:
    """Write ``<stem>-history.svg`` and, with enough trials, ``<stem>-importance.svg``.

    Args:
        study: The study.
        stem: The common part of the paths; its folder is created if it is missing.

    Returns:
        The paths.
    """
    with styled():
        made = {"history": _history(study), "importance": _importance(study)}
        stem.parent.mkdir(parents=True, exist_ok=True)
        return [
            save(figure, stem.with_name(f"{stem.name}-{name}.svg"))
            for name, figure in made.items()
            if figure is not None
        ]


def _history(study: Study) -> Figure | None:
    """Draw the return of each trial and the best so far; a pruned trial with its return when it was pruned."""
    from matplotlib.ticker import MaxNLocator

    completed = sorted(best_trials(study), key=lambda trial: trial.number)
    if not completed:
        return None
    figure, [[ax]] = panels(1, 1, height=1.4 * PANEL[1])
    figure.set_figwidth(2 * PANEL[0])
    numbers, values = [t.number for t in completed], [_value(t) for t in completed]
    style = style_of(search_of(study).policy)
    pruned = [t for t in finished(study) if t.state.name == "PRUNED" and t.value is not None]
    ax.plot(numbers, values, style.marker, color=style.colour, label="completed")
    ax.plot([t.number for t in pruned], [_value(t) for t in pruned], "x", color="#888888", label="pruned")
    best = [*accumulate(values, max)]
    ax.step([*numbers, numbers[-1]], [*best, best[-1]], where="post", color="black", label="best so far")
    ax.set(xlabel="trial", ylabel="validation return", title=study.study_name)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_below(figure, [ax])
    return figure


def _importance(study: Study) -> Figure | None:
    shares = importances(study)
    if not shares:
        return None
    names = [*shares][::-1]
    figure, [[ax]] = panels(1, 1, height=0.6 + 0.18 * len(names))
    figure.set_figwidth(2 * PANEL[0])
    ax.barh(names, [shares[name] for name in names], color=style_of(search_of(study).policy).colour)
    ax.grid(visible=False, axis="y")
    ax.set(xlabel="share of importance", title=f"{study.study_name}: what distinguishes the best trials")
    return figure


def _value(trial: FrozenTrial) -> float:
    return float(trial.value or 0.0)


def require_preset_file(path: Path) -> dict[str, Any]:
    """Return the content of a file that a preset will be saved to; empty if there is no file yet.

    Raises:
        ValueError: The file cannot be written, or is no file of presets.
    """
    if path.suffix != ".toml":
        raise ValueError(f"a preset's file must end in .toml, as in best.toml, got {path}")
    if not path.parent.is_dir():
        raise ValueError(f"{path.parent}, where {path.name} is to be saved, is not a folder; make it")
    if not path.exists():
        return {}
    try:
        content = parse_toml(files.read_text(path), "it", most=LARGEST_BY_HAND)
        presets = [preset for _, _, preset in _presets(content)]
    except (OSError, ValueError, AttributeError) as error:
        raise ValueError(f"{path} is there and cannot be read as a file of presets ({error})") from None
    if not all(isinstance(preset, dict) for preset in presets):
        raise ValueError(f"{path} is there and holds something else than presets; choose another name")
    return content


def _presets(content: dict[str, Any]) -> Iterator[tuple[str, str, Any]]:
    for algorithm, policies in content.items():
        for policy, presets in policies.items():
            for preset in presets.values():
                yield algorithm, policy, preset


def save_preset(study: Study, path: Path) -> None:
    """Write the best trial as the preset of its algorithm and policy, keeping other presets of the file.

    Args:
        study: The study.
        path: A ``.toml`` file.

    Raises:
        ValueError: No trial was completed, or as `require_preset_file` does.
    """
    content, search = require_preset_file(path), search_of(study)
    best = next(iter(best_trials(study)), None)
    if best is None:
        raise ValueError(
            f"the study {study.study_name!r} has no completed trial to make {path} of; run more --trials"
        )
    config = search.config_of(best.params).to_dict()
    which = {name: config.pop(name) for name in ("algorithm", "policy")}
    presets = content.setdefault(which["algorithm"], {}).setdefault(which["policy"], {})
    presets[DEFAULT] = {"source": _source(study, search, best), **config}
    files.write(path, tomli_w.dumps(content))


def _source(study: Study, search: Search, best: FrozenTrial) -> str:
    words = ["sympol", "tune", search.env, "--policy", search.policy, "--algorithm", search.algorithm]
    words += ["--total-timesteps", str(search.config["total_timesteps"]), "--preset", search.preset]
    words += (
        ["--env-kwargs", *(f"{k}={v}" for k, v in search.env_kwargs.items())] if search.env_kwargs else []
    )
    return (
        f"the best of {len(finished(study))} trials of `{shlex.join(words)}` (trial {best.number}), seeds "
        f"{', '.join(map(str, search.seeds))}, validation return {_value(best):.6g}"
    )
