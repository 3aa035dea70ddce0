"""Our MLP beside stable-baselines3's, PPO both, at the same budget: is the rival of our tables as good as it should be?

    python -m studies.benchmarks.sb3 [STEPS]

stable-baselines3 runs in an environment of its own (`studies.benchmarks.rivals`). Two tasks,
three trainings each, 100 test episodes a training; both with the settings of rl-baselines3-zoo, ours also with its
default preset, which is made for 1 M steps. In turns, so that a busy machine meets both. Writes
studies/results/sb3.json.
"""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

import sympol
from sympol.play import play

from .rivals.environment import train
from .timing import arguments_of, write_environments

TASKS = ("Acrobot-v1", "Pendulum-v1")
SEEDS = range(3)
EPISODES = 100
STEPS = 200_000
TEST_SEED = 2026
_SB3: dict[str, Any] = {
    "dynamic_rollout": False,
    "dynamic_batch": False,
    "minibatch_size": 64,
    "max_grad_norm": 0.5,
    "weight_decay": 0.0,
    "ent_coef": 0.0,
    "reduce_lr": False,
    "rollback": False,
}
ZOO: dict[str, dict[str, Any]] = {
    # the zoo normalises rewards, by which returns are of about unit size; ours are scaled by a constant
    "Acrobot-v1": {
        "num_envs": 16,
        "num_steps": 256,
        "gae_lambda": 0.94,
        "num_epochs": 4,
        "reward_scale": 0.05,
    },
    "Pendulum-v1": {"num_envs": 4, "num_steps": 1024, "gamma": 0.9, "num_epochs": 10, "normalize_obs": False},
}
RATES = {"Acrobot-v1": 3e-4, "Pendulum-v1": 1e-3}
"""What `rivals.ZOO` says, and stable-baselines3's defaults, in our words. Ours has no state-dependent exploration."""


def zoo(env: str) -> dict[str, Any]:
    """The zoo's settings as ours."""
    rates = {f"learning_rate_{part}": RATES[env] for part in ("actor", "critic", "log_std")}
    return {**_SB3, **ZOO[env], **rates}


def ours(env: str, seed: int, steps: int, settings: dict[str, Any]) -> dict[str, float]:
    """Train and test our MLP."""
    agent = sympol.PPO("mlp", env, seed=seed, **settings).learn(steps, progress_bar=False)
    returns = play(agent, agent.spec, EPISODES, seed=TEST_SEED + seed).returns
    return {"return_mean": float(returns.mean()), "steps": agent.num_timesteps}


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("steps", nargs="?", type=int, default=STEPS, metavar="STEPS")
    steps = parser.parse_args().steps
    table = Table(
        "environment", "sympol, zoo's settings", "stable-baselines3, zoo's", "sympol, default", "steps"
    )
    results = {}
    for env in TASKS:
        runs = [
            (ours(env, seed, steps, zoo(env)), train("sb3", steps, env, seed), ours(env, seed, steps, {}))
            for seed in SEEDS
        ]
        names = ("sympol", "stable-baselines3", "sympol_default")
        found = {name: [run[i]["return_mean"] for run in runs] for i, name in enumerate(names)}
        results[env] = {
            **found,
            "stable_baselines3_seconds": [run[1]["training_seconds"] for run in runs],
            "stable_baselines3_versions": runs[0][1]["versions"],
        }
        table.add_row(env, *(" ".join(f"{r:.0f}" for r in returns) for returns in found.values()), str(steps))
    Console().print(table)
    print(write_environments("sb3", {"steps": steps, "episodes": EPISODES, "seeds": list(SEEDS)}, results))


if __name__ == "__main__":
    main()
