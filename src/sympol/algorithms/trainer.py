"""A training on this machine: the compiled program, and one seed of it, segment by segment."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from jax.sharding import Mesh

from ..envs.env import Env
from ..envs.spec import EnvSpec
from ..policies.distributions import distribution_of
from .compiled import Compiled
from .config import Config, ConfigError
from .host_rollouts import HostRollouts
from .loop import Loop
from .registry import algorithm_class
from .rollouts import JaxRollouts
from .sharding import make_mesh, put, shardings
from .state import TrainState
from .warm_start import Start


def make_loop(source: Env | EnvSpec, config: Config, *, warm: bool = False, mesh: Mesh | None = None) -> Loop:
    """Return the training loop of an environment.

    Args:
        source: An environment written in JAX, or the description of one that the host steps.
        config: The static part of the configuration.
        warm: Whether trainings start from a tree.
        mesh: The devices to divide the environments of JAX among, if there are several.

    Returns:
        The loop; it opens no environment before its first segment.
    """
    on_host = isinstance(source, EnvSpec)
    features = len(source.features.names) if on_host else source.observation_space.shape[0]
    make_algorithm = algorithm_class(config.algorithm)
    algorithm = make_algorithm(
        config, distribution_of(source.action_space, scaled=config.scale_actions), features
    )
    if on_host:
        return Loop(config, algorithm, HostRollouts(source, config, algorithm), warm=warm)
    return Loop(config, algorithm, JaxRollouts(source, config, algorithm, mesh), warm=warm)


class Program:
    """The compiled loop that all seeds of one static configuration share; its arguments are those of `make_loop`."""

    def __init__(self, source: Env | EnvSpec, config: Config, *, warm: bool = False) -> None:
        mesh = None if config.num_devices == 1 else make_mesh(config.num_devices)
        loop = make_loop(source, config, warm=warm, mesh=mesh)
        self.rollouts = loop.rollouts
        self.template = loop.template()
        self.placement = None if mesh is None else shardings(mesh, self.template)
        """Where each array lies, if not all of them on one device."""
        if isinstance(source, EnvSpec):
            self.segment: Callable[..., TrainState] = loop.segment
            self.compile: Callable[..., float] = loop.compile_learn
        else:
            options = {} if self.placement is None else {"out_shardings": self.placement}
            self.segment = compiled = Compiled(loop.segment, **options)
            self.compile = compiled.compile


@functools.lru_cache(maxsize=8)
def _known_program(env: Env, config: Config, warm: bool) -> Program:
    return Program(env, config, warm=warm)


def make_program(source: Env | EnvSpec, config: Config, *, warm: bool = False) -> Program:
    """Return the program of a configuration, from a cache for environments in JAX that can be hashed.

    Raises:
        ConfigError: There are not as many devices as the configuration needs.
    """
    try:
        if not isinstance(source, EnvSpec):
            hash(source)
            return _known_program(source, config.static(), warm)
    except TypeError:  # an environment that nothing identifies
        pass
    return Program(source, config.static(), warm=warm)


class Trainer:
    """The training of one seed.

    Args:
        source: An environment written in JAX, or the description of one that the host steps.
        config: The configuration.
        seed: The seed of everything random.
        start: The tree to start from, if there is one.
        guided: Whether `begin_with` gives what to start from later, once a teacher is trained.
    """

    def __init__(
        self,
        source: Env | EnvSpec,
        config: Config,
        seed: int,
        start: Start | None = None,
        *,
        guided: bool = False,
    ) -> None:
        self._program = make_program(source, config, warm=guided or start is not None)
        self._initial = self._program.template
        if start is not None:
            actor, warm = start.parameters(config, seed, source.action_space)
            networks = self._initial.networks._replace(actor=actor)
            self._initial = self._initial._replace(networks=networks, warm=warm)
        self._hyper, self._seed = config.hyperparameters(), np.uint32(seed)
        self.limit = self._program.rollouts.limit
        """The number of steps after which validation cuts an episode."""
        self.was_cut = False
        """Whether the last validation cut an episode."""

    @property
    def latest(self) -> TrainState | None:
        """The last state before a segment failed, where the host has seen one."""
        state = self._program.rollouts.latest
        return None if state is None else state._replace(was_cut=None)

    def compile(self) -> float:
        """Compile, unless this process has done so before.

        Returns:
            The seconds it took.
        """
        return self._program.compile(*self._arguments(None, 0))

    def begin_with(self, **fields: Any) -> None:
        """Set what a guided training begins with.

        Args:
            fields: Fields of the `TrainState` that `sympol.algorithms.warm_start.install_teacher` reads.
        """
        self._initial = self._initial._replace(**fields)

    def advance(self, state: TrainState | None, stop: int) -> TrainState:
        """Train until a timestep is reached, and validate.

        Args:
            state: The state to continue from; None begins a new training.
            stop: The timestep.

        Returns:
            The new state.

        Raises:
            EnvironmentFailure: An environment on the host failed; `latest` is the last state before it.
        """
        state = self._program.segment(*self._arguments(state, stop))
        self.was_cut = bool(state.was_cut)
        return state._replace(was_cut=None)

    def template(self) -> TrainState:
        """Return a state of zeros; no environment is opened for it.

        Returns:
            A state with the shapes and types of every state of this training.
        """
        return self._program.template._replace(was_cut=None)

    def close(self) -> None:
        """Close what the host holds; `advance` opens it again."""
        self._program.rollouts.close()

    def _arguments(self, state: TrainState | None, stop: int) -> tuple[Any, ...]:
        state, first = (self._initial, True) if state is None else (state, False)
        metrics = state.metrics or self._program.template.metrics  # a loaded state has none
        state = state._replace(metrics=metrics, was_cut=np.bool_(False))
        if self._program.placement is not None:
            state = put(state, self._program.placement)
        return self._hyper, self._seed, state, np.bool_(first), np.int32(stop)


def make_trainer(
    spec: EnvSpec, config: Config, seed: int, start: Start | None = None, *, guided: bool = False
) -> Trainer:
    """Return the trainer of an environment, inside the compiled program if it is written in JAX.

    Args:
        spec: The environment.
        config: The configuration.
        seed: The seed of everything random.
        start: The tree to start from, if there is one.
        guided: Whether `Trainer.begin_with` gives what to start from later.

    Returns:
        The trainer; it opens no environment before `Trainer.advance`.

    Raises:
        ConfigError: The configuration needs more devices than there are, or than this environment can use.
    """
    if spec.env is None and config.num_devices > 1:
        raise ConfigError(
            f"num_devices must be 1 for {spec.name}, which the host steps, got {config.num_devices}; environments "
            "written in JAX can be spread over devices"
        )
    return Trainer(spec if spec.env is None else spec.env, config, seed, start, guided=guided)
