"""One training on several devices: each steps its share of the environments, all hold the networks.

The program is the one of a single device; told where its arrays lie, XLA divides the work and inserts what has to be
said between the devices (`jax.sharding`). With `jax.distributed` the devices may belong to several processes: each runs
the same program, and holds all of the networks and its own environments.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

from .config import ConfigError
from .state import TrainState

AXIS = "envs"


def make_mesh(num_devices: int) -> Mesh:
    """The first devices there are, as one axis.

    Raises:
        ConfigError: there are not so many.
    """
    devices = jax.devices()
    if len(devices) < num_devices:
        raise ConfigError(
            f"num_devices must be at most the number of devices, {len(devices)} ({devices[0].platform}), got "
            f"{num_devices}; on a CPU, XLA_FLAGS=--xla_force_host_platform_device_count={num_devices} makes as many"
        )
    return Mesh(np.array(devices[:num_devices]), (AXIS,), axis_types=(AxisType.Auto,))


def shardings(mesh: Mesh, state: TrainState) -> TrainState:
    """Return where each array of a state lies: one with a row per environment is divided, others are on each device."""
    whole, rows = NamedSharding(mesh, PartitionSpec()), NamedSharding(mesh, PartitionSpec(AXIS))
    everywhere: TrainState = jax.tree.map(lambda _: whole, state)

    def divided(part: Any) -> Any:
        return jax.tree.map(lambda _: rows, part)

    episodes = everywhere.episodes._replace(running_return=rows, running_length=rows)
    return everywhere._replace(
        env_state=divided(state.env_state), observation=divided(state.observation), episodes=episodes
    )


def put(state: TrainState, where: TrainState) -> TrainState:
    """A state that lies on the host or on one device, spread as the program wants it."""

    def spread(array: Any, sharding: NamedSharding) -> Any:
        if isinstance(array, jax.Array) and array.sharding == sharding:
            return array
        host = np.asarray(array)
        return jax.make_array_from_callback(host.shape, sharding, lambda index: host[index])

    return jax.tree.map(spread, state, where)


def divide_envs(array: Any, axis: int, mesh: Mesh | None) -> Any:
    """Inside the program: an array whose ``axis`` is that of the environments, divided along it."""
    if mesh is None:
        return array
    spec = PartitionSpec(*[None] * axis, AXIS)
    return jax.lax.with_sharding_constraint(array, NamedSharding(mesh, spec))
