"""The definition of a search, and the Optuna study that holds it: created, resumed, or refused."""

from __future__ import annotations

import contextlib
import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from ..algorithms.config import Config
from ..algorithms.presets import DEFAULT, preset
from ..envs.registry import resolve
from ..envs.spec import EnvSpec
from ..results.seeds import require_search_seed
from ..trees.actions import BoxActions
from .search_spaces import Space, corner, fields_of, fixed, from_json, space_of, to_json
from .storage import open_storage

if TYPE_CHECKING:
    from optuna import Study
    from optuna.pruners import BasePruner
    from optuna.samplers import BaseSampler
    from optuna.trial import FrozenTrial

_SEARCH = "sympol"
"""The user attribute of a study that holds its search."""
_NAMED = 4
"""The number of differences between two searches that are named."""
FAILURE = "failure"
"""The user attribute of a trial with the reason of a failure that would recur, such as a training that reached NaN."""


class OtherStudy(ValueError):
    """The storage has another search under this name."""


@dataclass(frozen=True)
class Search:
    """Everything that the trials of a study have in common, held by the study so that workers need nothing else."""

    env: str
    algorithm: str
    policy: str
    seeds: tuple[int, ...]
    """Seeds of the trainings of each trial, whose value is the mean of their validation returns."""
    preset: str
    config: Mapping[str, Any]
    """The fields of `Config` that are not searched."""
    space: Space
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        env: str,
        policy: str = "tree",
        algorithm: str = "ppo",
        *,
        total_timesteps: int = 1_000_000,
        seeds: Sequence[int] = (1000,),
        preset_name: str = DEFAULT,
        env_kwargs: Mapping[str, Any] | None = None,
        space: Space | None = None,
    ) -> Self:
        """Return a search that starts from a preset.

        Args:
            env: A Gymnasium id.
            policy: As in ``Config.policy``.
            algorithm: As in ``Config.algorithm``.
            total_timesteps: Environment steps of each training.
            seeds: Seeds of the trainings of each trial, of `seeds.SEARCH`.
            preset_name: The preset that gives the fields that are not searched.
            env_kwargs: Keyword arguments of the environment.
            space: The search space; by default the paper's.

        Raises:
            ValueError: The environment or preset is unknown, a seed is for reported trainings, or the space holds
                configs that cannot be trained.
        """
        seeds = tuple(require_search_seed(seed) for seed in seeds)
        spec = resolve(env, env_kwargs=env_kwargs)
        given = {"algorithm": algorithm, "policy": policy, "total_timesteps": total_timesteps}
        given |= {"method": "direct"} if policy == "tree" else {}
        base = preset(spec.preset_id, preset_name, policy=policy, algorithm=algorithm, given=given) | given
        if space is None:
            space = space_of(algorithm, policy, continuous=isinstance(spec.actions, BoxActions))
            base |= fixed(algorithm, policy)
        low, high = fields_of(corner(space, 0)), fields_of(corner(space, -1))
        Config.from_dict({**base, **high})  # the longest rollout must fit, too
        config = Config.from_dict({**base, **low}).to_dict()
        config = {name: value for name, value in config.items() if name not in low}
        return cls(env, algorithm, policy, seeds, preset_name, config, space, dict(env_kwargs or {}))

    def spec(self) -> EnvSpec:
        """Return the environment."""
        return resolve(self.env, env_kwargs=self.env_kwargs)

    def config_of(self, params: Mapping[str, Any]) -> Config:
        """Return the config of a trial with these parameters."""
        return Config.from_dict({**self.config, **fields_of(params)})

    def to_json(self) -> dict[str, Any]:
        """Return the search as a study keeps it."""
        return json.loads(json.dumps({**vars(self), "space": to_json(self.space)}))

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Return the search that a study keeps."""
        return cls(**{**content, "seeds": tuple(content["seeds"]), "space": from_json(content["space"])})

    def differences(self, now: Search) -> list[str]:
        """Return how another search differs from this one, each difference as a phrase."""
        was, is_now = self._flat(), now._flat()
        words = [
            f"{name} {was.get(name)}, not {is_now.get(name)}"
            for name in {**was, **is_now}
            if was.get(name) != is_now.get(name)
        ]
        return [*words, *(["another search space"] if self.space != now.space else [])]

    def _flat(self) -> dict[str, Any]:
        config = Config(algorithm=self.algorithm, policy=self.policy).to_dict()  # pyright: ignore[reportArgumentType]
        searched = fields_of(
            corner(self.space, 0)
        )  # fields that a study did not have yet were at their defaults
        config = {name: value for name, value in {**config, **self.config}.items() if name not in searched}
        return {**self.to_json(), **json.loads(json.dumps(config)), "config": None, "space": None}


def open_study(
    storage: str,
    name: str,
    search: Search | None = None,
    *,
    sampler: BaseSampler | None = None,
    pruner: BasePruner | None = None,
) -> Study:
    """Return the study of a name, creating it if ``search`` is given and there is none.

    Args:
        storage: A file or a PostgreSQL address, see `open_storage`.
        name: The name of the study.
        search: The search that the study must hold.
        sampler: Optuna's sampler.
        pruner: Optuna's pruner.

    Raises:
        OtherStudy: The study is of another search, or was not created by `sympol tune`.
        StorageError, ImportError, ValueError: See `open_storage`.
    """
    opened = open_storage(storage)
    import optuna

    with quiet():
        if search is None:
            return optuna.load_study(study_name=name, storage=opened, sampler=sampler, pruner=pruner)
        study = optuna.create_study(
            study_name=name, storage=opened, direction="maximize", load_if_exists=True
        )
    if _SEARCH not in study.user_attrs:
        if study.get_trials(deepcopy=False):
            raise OtherStudy(f"the study {name!r} was not created by sympol tune; choose another --study")
        study.set_user_attr(_SEARCH, search.to_json())
    if changed := search_of(study).differences(search):
        more = f" and {len(changed) - _NAMED} more that differ" if len(changed) > _NAMED else ""
        raise OtherStudy(
            f"the study {name!r} was created with {'; '.join(changed[:_NAMED])}{more}; resume it with the same "
            "arguments, or choose another --study"
        )
    return study


def search_of(study: Study) -> Search:
    """Return the search of a study."""
    return Search.from_json(study.user_attrs[_SEARCH])


def finished(study: Study) -> list[FrozenTrial]:
    """Return the trials that need not run again: completed, pruned, or failed in a way that would recur.

    Trials that are running, or whose worker was killed, are left out.
    """
    from optuna.trial import TrialState

    return [
        trial
        for trial in study.get_trials(deepcopy=False)
        if trial.state in (TrialState.COMPLETE, TrialState.PRUNED)
        or (trial.state == TrialState.FAIL and FAILURE in trial.user_attrs)
    ]


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silence Optuna's log messages and experimental warnings in this context."""
    import optuna

    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            yield
    finally:
        optuna.logging.set_verbosity(before)
