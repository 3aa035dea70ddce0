"""What a search is, and the study in the storage that holds it: begun, gone on with, or refused."""

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
"""Where a study says what it searches."""
_NAMED = 4
"""So many differences between two searches are named."""
FAILURE = "failure"
"""Where a trial says why it failed, if the same would come again: a training that came to NaN."""


class OtherStudy(ValueError):
    """The storage has another search under that name."""


@dataclass(frozen=True)
class Search:
    """All that trials have in common. A study holds it, so that a worker needs the study and nothing else."""

    env: str
    algorithm: str
    policy: str
    seeds: tuple[int, ...]
    """Of the trainings of each trial; its value is the mean of their validation returns."""
    preset: str
    config: Mapping[str, Any]
    """Fields that are not searched."""
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
        """Put a search together from its preset and, unless another is given, the paper's space.

        Raises:
            ValueError: an unknown environment or preset, a seed that is reported, or a space in which there are
                configs that cannot be trained.
        """
        seeds = tuple(require_search_seed(seed) for seed in seeds)
        spec = resolve(env, env_kwargs=env_kwargs)
        base: dict[str, Any] = preset(spec.preset_id, preset_name, policy=policy, algorithm=algorithm)
        base |= {"algorithm": algorithm, "policy": policy, "total_timesteps": total_timesteps}
        if space is None:
            space = space_of(algorithm, policy, continuous=isinstance(spec.actions, BoxActions))
            base |= fixed(algorithm, policy)
        low, high = fields_of(corner(space, 0)), fields_of(corner(space, -1))
        Config.from_dict({**base, **high})  # the longest rollout must fit, too
        config = Config.from_dict({**base, **low}).to_dict()
        config = {name: value for name, value in config.items() if name not in low}
        return cls(env, algorithm, policy, seeds, preset_name, config, space, dict(env_kwargs or {}))

    def spec(self) -> EnvSpec:
        """The environment."""
        return resolve(self.env, env_kwargs=self.env_kwargs)

    def config_of(self, params: Mapping[str, Any]) -> Config:
        """The config of a trial."""
        return Config.from_dict({**self.config, **fields_of(params)})

    def to_json(self) -> dict[str, Any]:
        """As a study keeps it."""
        return json.loads(json.dumps({**vars(self), "space": to_json(self.space)}))

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """The same back."""
        return cls(**{**content, "seeds": tuple(content["seeds"]), "space": from_json(content["space"])})

    def differences(self, now: Search) -> list[str]:
        """How another search differs from this one, in words."""
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
    """The study of that name; with ``search`` it is begun if there is none.

    Raises:
        OtherStudy: it is of another search, or was not begun here.
        StorageError, ImportError, ValueError: see `open_storage`.
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
            raise OtherStudy(f"the study {name!r} was not begun by sympol tune; choose another --study")
        study.set_user_attr(_SEARCH, search.to_json())
    if changed := search_of(study).differences(search):
        more = f" and {len(changed) - _NAMED} more that differ" if len(changed) > _NAMED else ""
        raise OtherStudy(
            f"the study {name!r} was begun with {'; '.join(changed[:_NAMED])}{more}; go on with it as it was, or "
            "choose another --study"
        )
    return study


def search_of(study: Study) -> Search:
    """What a study searches."""
    return Search.from_json(study.user_attrs[_SEARCH])


def finished(study: Study) -> list[FrozenTrial]:
    """Trials that need not be run again: completed, pruned, or failed in a way that would come again.

    Neither those that are running, nor those whose worker was killed.
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
    """Nothing of Optuna's own words: what a trial came to is said by us."""
    import optuna

    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            yield
    finally:
        optuna.logging.set_verbosity(before)
