"""Trains a small CartPole on devices that are not there, alone or as one of two processes; prints what came of it.

    python many_devices.py NUM_DEVICES FOLDER [ADDRESS PROCESS_ID]

XLA_FLAGS must make the devices. The agent is saved to FOLDER, one for each process.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import jax
import numpy as np

import sympol
from sympol.algorithms.trainer import make_trainer


def main(num_devices: int, folder: str, address: str = "", process: str = "0") -> None:
    if address:
        jax.distributed.initialize(address, num_processes=2, process_id=int(process))
    agent = sympol.PPO(
        "tree",
        "CartPole-v1",
        seed=3,
        depth=3,
        critic_hidden=(8,),
        num_envs=8,
        num_devices=num_devices,
        num_steps=128,
        num_evals=2,
        total_timesteps=8192,
        dynamic_rollout=True,
    )
    if address:
        meet(Path(folder).parent, process, agent)
    agent.learn(progress_bar=False)
    agent.save(folder)
    assert agent.state is not None
    networks = [np.asarray(leaf).ravel().tolist() for leaf in jax.tree.leaves(agent.state.networks)]
    spread = len(agent.state.observation.sharding.device_set)
    print(json.dumps({"networks": networks, "spread": spread, "processes": jax.process_count()}))


def meet(folder: Path, process: str, agent: sympol.PPO) -> None:
    """Wait until both have compiled: the first to run gives the other only half a minute to come."""
    make_trainer(agent.spec, agent.config, agent.seed).compile()
    (folder / f"{process}.compiled").touch()
    while len(list(folder.glob("*.compiled"))) < 2:
        time.sleep(0.05)


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
