"""A training that does not fit into memory is refused before it begins, and one that fits is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

import sympol
from sympol.algorithms import memory
from sympol.algorithms.config import ConfigError
from sympol.algorithms.memory import machine_memory, require_memory, require_room, size_of
from sympol.algorithms.rollouts import empty_rollout
from sympol.policies.distributions import distribution_of

from ..tiny import TINY, agent, quick_compiles, refused

__all__ = ["quick_compiles"]

HUGE: dict[str, Any] = {
    "num_envs": 65536,
    "num_steps": 8192,
    "total_timesteps": 2**29,
    "dynamic_rollout": False,
}
"""29 GB of CartPole, and more of larger observations."""


GB = 1024**3


def allow(monkeypatch: pytest.MonkeyPatch, limit: int) -> None:
    monkeypatch.setattr(memory, "machine_memory", lambda: (limit, "this machine has %s"))


def certain(agent: sympol.PPO) -> int:
    """What is surely held at once: the arrays themselves, made here and counted."""
    rollout = empty_rollout(
        len(agent.spec.features.names), distribution_of(agent.spec.action_space), agent.config
    )
    return sum(np.asarray(part).nbytes for part in rollout) + 3 * np.asarray(rollout.reward).nbytes


@pytest.mark.parametrize("backend", ["jax", "host"])
def test_at_the_edge_a_rollout_fits_and_a_byte_beyond_it_does_not(monkeypatch, backend):
    learner = agent(backend=backend)
    need = certain(learner)
    allow(monkeypatch, need)
    require_memory(learner.spec, learner.config)
    allow(monkeypatch, need - 1)
    with pytest.raises(
        ConfigError, match=r"needs .* GB of memory, this machine has .* GB; lower num_envs, num_steps"
    ):
        require_memory(learner.spec, learner.config)


def test_the_longest_rollout_counts_not_the_first(monkeypatch):
    learner = agent(total_timesteps=8192)
    allow(monkeypatch, certain(learner) - 1)
    with pytest.raises(ConfigError, match="the longest rollout, 256 steps of 4 environments"):
        require_memory(learner.spec, learner.config)


def test_the_compiled_program_counts_too(monkeypatch):
    compiled = jax.jit(lambda x: (x @ x).sum()).lower(np.ones((512, 512), np.float32)).compile()
    plan = compiled.memory_analysis()
    need = plan.argument_size_in_bytes + plan.output_size_in_bytes + plan.temp_size_in_bytes
    assert need > 512 * 512 * 4
    allow(monkeypatch, need)
    require_room(compiled)
    allow(monkeypatch, need - 1)
    with pytest.warns(UserWarning, match=r"may need .*, this machine has .* GB; if it is killed, lower"):
        require_room(compiled)
    allow(monkeypatch, need // 2 - 1)
    with pytest.raises(ConfigError, match=r"the compiled training needs .*, this machine has .* GB; lower"):
        require_room(compiled)


def test_what_fits_is_trained_and_what_does_not_is_refused_before_a_step(monkeypatch):
    learner = agent()
    allow(monkeypatch, certain(learner) // 2)
    with pytest.raises(ConfigError, match="needs"):
        learner.learn(progress_bar=False)
    assert learner.num_timesteps == 0
    monkeypatch.undo()
    assert learner.learn(progress_bar=False).num_timesteps >= TINY["total_timesteps"]


def test_the_command_says_so_in_one_line_and_writes_nothing(monkeypatch, tmp_path, capsys):
    allow(monkeypatch, 24 * GB)
    words = [
        "--num-envs",
        "65536",
        "--num-steps",
        "8192",
        "--total-timesteps",
        str(2**29),
        "--no-dynamic-rollout",
    ]
    said = refused(capsys, "train", "CartPole-v1", *words, "--run-dir", tmp_path / "run")
    assert "needs 29.0 GB of memory, this machine has 25.8 GB; lower num_envs" in said
    assert not (tmp_path / "run").exists()


def test_sizes_are_those_of_shapes_that_nobody_could_make():
    learner = sympol.PPO("tree", "CartPole-v1", **HUGE)
    shapes = jax.eval_shape(
        lambda: empty_rollout(4, distribution_of(learner.spec.action_space), learner.config)
    )
    assert size_of(shapes) == 2**29 * (4 * 4 + 4 + 4 + 1 + 1 + 4 * 4)


def machine(root: Path, *, cgroup: str, swap: int = 0, limits: dict[str, str] | None = None) -> Path:
    (root / "proc/self").mkdir(parents=True)
    (root / "proc/meminfo").write_text(
        f"MemTotal: {24 * GB // 1024} kB\nMemFree: 1 kB\nSwapTotal: {swap // 1024} kB\n"
    )
    (root / "proc/self/cgroup").write_text(cgroup)
    for name, value in (limits or {}).items():
        file = root / "sys/fs/cgroup" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(value)
    return root


@pytest.mark.parametrize(
    ("cgroup", "limits", "has"),
    [
        ("0::/\n", {}, 24),
        ("0::/\n", {"memory.max": "max\n"}, 24),
        ("0::/\n", {"memory.max": f"{4 * GB}\n"}, 4),
        ("0::/a/b\n", {"a/b/memory.max": "max\n", "a/memory.max": f"{3 * GB}\n"}, 3),
        ("0::/not/visible/here\n", {"memory.max": f"{5 * GB}\n"}, 5),
        ("9:cpu:/\n4:memory:/x\n0::/\n", {"memory/x/memory.limit_in_bytes": f"{2 * GB}\n"}, 2),
        ("4:memory:/x\n", {"memory/memory.limit_in_bytes": "9223372036854771712\n"}, 24),
        ("4:cpu,memory:/elsewhere\n", {"memory/memory.limit_in_bytes": f"{6 * GB}\n"}, 6),
    ],
)
def test_a_container_has_what_its_control_group_allows(tmp_path, cgroup, limits, has):
    bytes_, where = machine_memory(machine(tmp_path, cgroup=cgroup, limits=limits))
    assert bytes_ == has * GB
    assert where.startswith("this machine" if has == 24 else "this container")


def test_swap_is_memory(tmp_path):
    assert machine_memory(machine(tmp_path, cgroup="0::/\n", swap=8 * GB))[0] == 32 * GB


def test_this_machine_has_memory():
    assert 2**28 < machine_memory()[0] < 2**50
