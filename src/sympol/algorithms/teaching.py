"""The parts of a training with a teacher: how its steps are divided, and the teacher's config. No JAX is needed."""

from __future__ import annotations

from .config import Config
from .presets import preset
from .work import stops

TEACHING = 0.5
"""The part of the steps for which the teacher is trained."""
DISTILLING = 0.15
"""The part of the steps for which teacher and trees play episodes to distill from."""
MOST_DISTILLING = 100_000
"""The most steps of these episodes."""
_SHARED = (
    *(
        "algorithm",
        "num_envs",
        "num_devices",
        "num_eval_episodes",
        "eval_share",
        "normalize_obs",
        "trust_bounds",
    ),
    *("scale_actions", "normalize_returns", "gamma", "reward_scale", "critic_hidden", "log_std_init"),
)
"""Fields of the config that are the teacher's, too."""


def teacher_config(preset_id: str, config: Config) -> Config:
    """Return the configuration of the teacher.

    Args:
        preset_id: The id of the environment, for which there may be a preset.
        config: The configuration of the whole training.

    Returns:
        The configuration of an MLP that is trained for the first part of the steps.
    """
    first = teacher_stops(config)
    given = {name: getattr(config, name) for name in _SHARED}
    given |= {"policy": "mlp", "total_timesteps": first[-1], "num_evals": len(first)}
    values = preset(preset_id, policy="mlp", algorithm=config.algorithm, given=given)
    return Config.from_dict({**values, **given})


def teacher_stops(config: Config) -> list[int]:
    """Return the timesteps after which the teacher is validated; the last one is the end of its training."""
    all_stops = stops(config)
    return all_stops[: max(1, round(TEACHING * len(all_stops)))]


def distilling_steps(config: Config) -> int:
    """Return the number of environment steps that distillation has."""
    return min(int(DISTILLING * config.total_timesteps), MOST_DISTILLING)
