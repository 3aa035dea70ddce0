"""A training in its folder: begun, gone on with after an interruption, tested and summed up."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from .agents import Agent, Callback, Report, load_run
from .algorithms.config import SIZE_LIMITS
from .algorithms.state import Guide
from .play import FEW, Episodes
from .provenance import versions
from .runs.formatting import decimals
from .runs.run import Run
from .teachers import has_soft_tree, keep_soft_tree


def save_into(run: Run) -> Callback:
    """A callback that writes a row and a checkpoint after each validation."""

    def keep(report: Report) -> None:
        with run.writing():
            run.metrics.append(report.metrics)
        assert report.agent.state is not None
        run.save_checkpoint(report.agent.state)  # after its row: resuming drops rows that have no checkpoint

    return keep


def resume_agent(run: Run) -> Agent:
    """The agent of a run where it was left, ready to `learn` on; rows beyond its checkpoint are dropped.

    From here on no other process may write in the run (`Run.take`).

    Raises:
        RunError: see `sympol.load`; or another process writes in the run, or it cannot be written.
    """
    run.require_own_checkpoints()
    with run.writing():
        run.take()
    agent = load_run(run)
    with run.writing():
        run.metrics.forget_after(agent.num_timesteps)
    return agent


def finish(
    agent: Agent, run: Run, tested: Episodes | None, sampled: Episodes | None, eval_seed: int
) -> dict[str, Any]:
    """Write a trained tree in every form, with the visits of its test episodes; return what came of the training."""
    assert agent.state is not None
    validation = agent.state.validation
    summary: dict[str, Any] = {
        "env": agent.spec.name,
        "seed": agent.seed,
        "timesteps": agent.num_timesteps,
        **_size(agent),
        "validation_return": float(validation.best_return),
        "best_timestep": int(validation.best_timestep),
        **({} if agent.start is None else {"start": agent.start.about()}),
        **({} if agent.state.guide is None else {"guide": _about(agent.state.guide)}),
    }
    if tested is not None and sampled is not None:
        summary |= {
            "return_mean": float(tested.returns.mean()),
            "return_std": float(tested.returns.std()),
            "sampled_return_mean": float(sampled.returns.mean()),
            "sampled_return_std": float(sampled.returns.std()),
            "episodes": len(tested.returns),
            "eval_seed": eval_seed,
        }
        warn_of_noise(agent.spec.name, tested.returns, sampled.returns)
    if agent.has_tree:
        tree = agent.tree()
        run.save_tree(tree if tested is None else tree.with_visits(tested.observations))
    elif has_soft_tree(agent):
        with run.writing():
            summary |= keep_soft_tree(agent, run.path, None if tested is None else tested.observations)
    return summary | {"preset": run.metadata["preset"], "run_dir": str(run.path), "versions": versions()}


WORSE, BETTER = 0.4, 0.8
"""By what share of the larger mean return a policy may be worse, or better, with its best actions than with sampled."""


class NeedsNoise(UserWarning):
    """A policy earns much more, or much less, where it samples its actions than where it takes the best."""


def warn_of_noise(env_name: str, best: np.ndarray, sampled: np.ndarray) -> None:
    """Warn where a policy's returns with its best actions are far from those with sampled actions.

    Far is more than the spread of the returns, more than three standard errors, and more than `WORSE` of the larger
    mean. Noise always costs something, and costs much early in a training: where sampling earns less, `BETTER` takes
    the place of `WORSE`.
    """
    earned, by_chance = float(best.mean()), float(sampled.mean())
    relies = by_chance > earned
    apart, larger = abs(earned - by_chance), max(abs(earned), abs(by_chance))
    few, spread = min(len(best), len(sampled)), np.hypot(best.std(), sampled.std())
    far = max(spread / np.sqrt(2), 3 * spread / np.sqrt(few), (WORSE if relies else BETTER) * larger)
    if few < FEW or apart <= far:
        return
    n = decimals(larger)
    why = (
        "so it relies on its noise, which the deterministic policy that is kept does not have. Train longer, let the "
        "entropy bonus end as a price (--ent-end-factor -1), or allow a deeper tree (--depth)"
        if relies
        else "so training ended with much noise left, and has hardly improved the deterministic policy that is kept. "
        "Train longer, or lower the entropy bonus (--ent-coef, --ent-end-factor)"
    )
    warnings.warn(
        f"on {env_name} the policy earns {earned:,.{n}f} with its best actions and {by_chance:,.{n}f} with sampled "
        f"ones, {why}",
        NeedsNoise,
        stacklevel=1,
    )


def _about(guide: Guide) -> dict[str, Any]:
    """Return what a training with a teacher did before the tree's own training."""
    return {
        "teacher_timesteps": int(guide.teacher_steps),
        "distill_timesteps": int(guide.steps) - int(guide.teacher_steps),
        "teacher_return": float(guide.teacher_return),
        "random_return": float(guide.random_return),
        "distilled_return": float(guide.tree_return),
        "began_with": "the distilled tree" if guide.is_distilled else "a single leaf",
    }


def _size(agent: Agent) -> dict[str, float]:
    if not agent.has_tree:
        return {}
    tree, config = agent.tree(), agent.config
    limits = {name: value for name in SIZE_LIMITS if (value := getattr(config, name))}
    return {
        **limits,
        "nodes": tree.n_nodes,
        "nodes_unpruned": agent.tree(prune=False).n_nodes,
        "leaves": tree.n_leaves,
        "depth": tree.depth,
    }


def training_seconds(run: Run) -> float:
    """Seconds that all validated segments took, without compiling, however often the training was interrupted."""
    elapsed = np.array([0.0, *(row["time/time_elapsed"] for row in run.metrics.read())])
    elapsed = elapsed[np.isfinite(elapsed)]
    steps = np.diff(elapsed)
    return float(
        np.where(steps >= 0, steps, elapsed[1:]).sum()
    )  # after an interruption the clock starts at 0


def has_run(folder: Path) -> bool:
    """Return whether a folder contains a run."""
    return (folder / "config.toml").is_file()
