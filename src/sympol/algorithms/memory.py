"""Check before a training begins that it fits into memory, so that the kernel does not end it later.

Two numbers are compared with the machine's. The smaller follows from shapes alone: every training writes its longest
rollout and three numbers for each of its samples, and holds them all at once. The larger is XLA's plan of the compiled
program, which has the activations, too; on a CPU parts of such a plan are never touched, a quarter of it in a large
rollout without stages, so only a plan of twice the memory is refused, and above the memory there is a warning.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import jax

from ..envs.spec import EnvSpec
from ..policies.distributions import distribution_of
from .config import Config, ConfigError
from .rollouts import empty_rollout

_REMEDY = "lower num_envs, num_steps or growth"
_UNTOUCHED = 2
"""How many times larger than what is touched a plan may be on a CPU."""
_NO_LIMIT = 1 << 60
"""What a control group without a limit says is more than this."""


def require_memory(spec: EnvSpec, config: Config) -> None:
    """Raise ConfigError where not even the longest rollout fits into memory."""
    features = len(spec.features.names)
    distribution = distribution_of(spec.action_space)
    rollout = jax.eval_shape(lambda: empty_rollout(features, distribution, config))
    need = size_of((rollout, [rollout.reward] * 3)) // config.num_devices
    limit, where = device_memory()
    if spec.env is None:  # the host has the rollout as well
        limit, where = min((limit, where), machine_memory())
    if need > limit:
        steps = config.chunk_steps << config.max_stage
        raise ConfigError(
            f"the longest rollout, {steps:,} steps of {config.num_envs:,} environments with {features:,} features, "
            f"needs {_amounts(need, limit, where)}; {_REMEDY} (now {config.num_envs}, {config.num_steps}, "
            f"{config.growth})"
        )


def require_room(executable: Any) -> None:
    """Raise ConfigError where a compiled program does not fit into memory; warn where it may not."""
    plan = executable.memory_analysis()
    if plan is None:  # a platform that does not tell
        return
    need = plan.argument_size_in_bytes + plan.output_size_in_bytes + plan.temp_size_in_bytes
    limit, where = device_memory()
    remedy = f"{_REMEDY}, or minibatch_size"
    if need > limit * (_UNTOUCHED if jax.default_backend() == "cpu" else 1):
        raise ConfigError(f"the compiled training needs {_amounts(need, limit, where)}; {remedy}")
    if need > limit:
        warnings.warn(
            f"the compiled training may need {_amounts(need, limit, where)}; if it is killed, {remedy}",
            stacklevel=2,
        )


def size_of(arrays: Any) -> int:
    """Return the bytes of a pytree of arrays, or of their shapes."""
    return sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(arrays))


def device_memory() -> tuple[int, str]:
    """Return the bytes that JAX may use on its first device, and a text that names the limit."""
    device = jax.devices()[0]
    if device.platform == "cpu":
        return machine_memory()
    limit = (device.memory_stats() or {}).get("bytes_limit", _NO_LIMIT)
    return limit, f"JAX has %s of this {device.device_kind}"


def machine_memory(root: Path = Path("/")) -> tuple[int, str]:
    """Bytes of memory and swap that this process can have, and what sets the limit: the machine or a container.

    ``root`` is where ``proc`` and ``sys`` are.
    """
    try:
        fields = dict(line.split(":") for line in (root / "proc/meminfo").read_text().splitlines())
        memory, swap = (1024 * int(fields[name].split()[0]) for name in ("MemTotal", "SwapTotal"))
    except (OSError, ValueError, KeyError):  # not Linux
        return _physical_memory(), "this machine has %s"
    limit = _container_limit(root)
    if limit < memory:
        return limit + swap, "this container has %s"
    return memory + swap, "this machine has %s"


def _physical_memory() -> int:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return _NO_LIMIT


def _container_limit(root: Path) -> int:
    """The least limit of this process's control groups and of those that they are in, of either version."""
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return _NO_LIMIT
    limits = [_NO_LIMIT]
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        base = "sys/fs/cgroup/memory" if controllers else "sys/fs/cgroup"
        name = "memory.limit_in_bytes" if controllers else "memory.max"
        group = Path(path.lstrip("/"))
        for folder in (
            group,
            *group.parents,
        ):  # in a container only the last may be there: the path is the host's
            try:
                limits.append(int((root / base / folder / name).read_text()))
            except (OSError, ValueError):  # ValueError: "max"
                continue
    return min(limits)


def _amounts(need: int, limit: int, where: str) -> str:
    """Both in gigabytes, with as many digits as tell them apart."""
    digits = next((n for n in range(1, 9) if round(need / 1e9, n) > round(limit / 1e9, n) > 0), 9)
    return f"{need / 1e9:,.{digits}f} GB of memory, {where % f'{limit / 1e9:,.{digits}f} GB'}"
