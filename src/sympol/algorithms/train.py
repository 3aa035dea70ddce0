"""The training loop: segment after segment, and between two of them the host saves, reports and may stop.

For a pure-JAX environment a segment is one call of one compiled program. For a Gymnasium environment the host
collects, and only the update is compiled (`train_host`).
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ..envs.env import Env
from ..envs.spec import EnvSpec
from .config import Config, ConfigError
from .sharding import make_mesh, put, shardings
from .state import TrainState
from .train_host import HostTrainer
from .train_loop import make_segment
from .trainer import Compiled, Trainer
from .validate import limit_in
from .warm_start import Start


def stops(config: Config) -> list[int]:
    """The timesteps after which the training validates, reports and saves."""
    evenly = np.linspace(0, config.total_timesteps, config.num_evals + 1)[1:]
    return sorted({int(np.ceil(stop)) for stop in evenly})


class CompiledTrainer(Trainer):
    """Of a pure-JAX environment: a segment is one call."""

    def __init__(self, env: Env, config: Config, seed: int, start: Start | None = None) -> None:
        self._program, self._where = _program(env, config.static(), warm=start is not None)
        template = self._program.template
        self._begin_with = template
        if start is not None:
            actor, warm = start.parameters(config, seed)
            self._begin_with = template._replace(networks=template.networks._replace(actor=actor), warm=warm)
        self._hyper, self._seed = config.hyperparameters(), np.uint32(seed)
        self.limit = limit_in(env, config)

    def compile(self) -> float:
        """See `Trainer`."""
        return self._program.compile(*self._arguments(None, 0))

    def advance(self, state: TrainState | None, stop: int) -> TrainState:
        """See `Trainer`."""
        state = self._program(*self._arguments(state, stop))
        self.was_cut = bool(state.cut)
        return state._replace(cut=None)

    def template(self) -> TrainState:
        """See `Trainer`."""
        return self._program.template._replace(cut=None)

    def _arguments(self, state: TrainState | None, stop: int) -> tuple[Any, ...]:
        state, first = (self._begin_with, True) if state is None else (state, False)
        state = state._replace(cut=np.bool_(False))
        if self._where is not None:
            state = put(state, self._where)
        return self._hyper, self._seed, state, np.bool_(first), np.int32(stop)


def _program(env: Env, config: Config, *, warm: bool) -> tuple[Compiled, TrainState | None]:
    """The compiled segment, and where its state lies if not all of it on one device."""
    try:
        hash(env)
    except TypeError:  # nothing to know it by: compiled anew for each training
        return _make_program(env, config, warm)
    return _known_program(env, config, warm)


@functools.lru_cache(maxsize=8)
def _known_program(env: Env, config: Config, warm: bool) -> tuple[Compiled, TrainState | None]:
    return _make_program(env, config, warm)


def _make_program(env: Env, config: Config, warm: bool) -> tuple[Compiled, TrainState | None]:
    if config.num_devices == 1:
        return Compiled(*make_segment(env, config, warm=warm)), None
    mesh = make_mesh(config.num_devices)
    segment, template = make_segment(env, config, mesh, warm=warm)
    where = shardings(mesh, template)
    return Compiled(segment, template, out_shardings=where), where


def make_trainer(spec: EnvSpec, config: Config, seed: int, start: Start | None = None) -> Trainer:
    """Compiled where the environment is written in JAX, through the host otherwise; from ``start`` if there is one."""
    if spec.env is not None:
        return CompiledTrainer(spec.env, config, seed, start)
    if config.num_devices > 1:
        raise ConfigError(
            f"num_devices must be 1 for {spec.name}, which the host steps, got {config.num_devices}; environments "
            "written in JAX can be spread over devices"
        )
    return HostTrainer(spec, config, seed, start)
