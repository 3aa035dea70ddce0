"""How fast experience is gathered: environments in JAX or machine code beside the packages they are twins of.

    python -m studies.benchmarks.worlds [--num-envs N] [--repeats N]

MiniGrid in JAX (`JaxRollouts.collect`, inside a compiled program, storing each transition as training does) beside
Farama's package, LunarLander in machine code beside Gymnasium's. Those step as many copies on the host, by
SyncVectorEnv or in a loop, and store nothing. Everywhere the same new tree of depth 5 acts, sampling; on the host
it is the extracted one in NumPy, the fastest there is for so few observations. Twins in turns, the least of many
repeats of each. Writes studies/results/worlds.json.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from sympol.algorithms.compiled import COMPILER_OPTIONS
from sympol.algorithms.config import Config
from sympol.algorithms.state import TrainState
from sympol.algorithms.trainer import make_loop
from sympol.envs.registry import resolve
from sympol.envs.spec import Backend, EnvSpec
from sympol.play import sample_actions
from sympol.policies.extract import extract_tree
from sympol.trees import DecisionTree

from .timing import Timing, arguments_of, interleaved, write

MINIGRID = (
    "MiniGrid-Empty-Random-6x6-v0",
    "MiniGrid-DoorKey-5x5-v0",
    "MiniGrid-LavaGapS5-v0",
    "MiniGrid-LavaGapS7-v0",
    "MiniGrid-DistShift1-v0",
)
TWINS: dict[str, tuple[Backend, Backend]] = {
    **dict.fromkeys(MINIGRID, ("jax", "host")),
    "LunarLander-v3": ("native", "host"),
}
DEPTH = 5


def beginning(spec: EnvSpec, config: Config) -> TrainState:
    """Return the state of a new training, with an untrained policy."""
    loop = make_loop(spec.env or spec, config)
    return jax.jit(loop.begin)(config.hyperparameters(), np.uint32(0), loop.template())


def extracted(spec: EnvSpec, state: TrainState) -> DecisionTree:
    """The same policy, as it is read."""
    return extract_tree(
        state.networks.actor,
        np.asarray(state.normalizer.shift),
        np.asarray(state.normalizer.scale),
        actions=spec.actions,
        feature_names=spec.features.names,
        feature_low=spec.features.low,
        feature_high=spec.features.high,
        groups=spec.features.groups,
    )


def in_program(spec: EnvSpec, config: Config) -> Callable[[], Any]:
    """Return a function that collects one whole rollout at each call and continues from the last one."""
    assert spec.env is not None
    rollouts = make_loop(spec.env, config).rollouts

    def gather(state: TrainState, buffer: Any) -> Any:
        key, collect_key = jax.random.split(jax.random.wrap_key_data(state.key))
        stage = jax.numpy.int32(config.max_stage)
        state, experience = rollouts.collect(state, buffer, stage, collect_key)
        return state._replace(key=jax.random.key_data(key)), experience.rollout

    # the buffer holds one array twice, which cannot be donated
    now = [beginning(spec, config), jax.tree.map(jax.numpy.copy, rollouts.buffer())]
    compiled = jax.jit(gather, donate_argnums=1).lower(*now).compile(COMPILER_OPTIONS)

    def call() -> Any:
        now[:] = compiled(*now)
        return now

    return call


def on_host(spec: EnvSpec, config: Config) -> Callable[[], Any]:
    """Take the steps of the shortest rollout at each call, going on from the last one."""
    tree, rng = extracted(spec, beginning(spec, config)), np.random.default_rng(0)
    envs = spec.host_envs(config.num_envs)
    now = [envs.reset(seed=0)]

    def call() -> Any:
        for _ in range(config.chunk_steps):
            now[0] = envs.step(sample_actions(tree, now[0], rng).astype(np.int32))[1]
        return now

    return call


def steps_per_second(env: str, num_envs: int, repeats: int) -> dict[Backend, dict[str, float]]:
    """Of each of two twins."""
    calls, steps = {}, {}
    for backend in TWINS[env]:
        spec = resolve(env, backend=backend)
        if backend == "jax":
            config = Config(depth=DEPTH, num_envs=num_envs, total_timesteps=8 * 64 * 16 * num_envs)
            calls[backend], steps[backend] = in_program(spec, config), config.chunk_size << config.max_stage
        else:
            config = Config(depth=DEPTH, num_envs=num_envs)
            calls[backend], steps[backend] = on_host(spec, config), config.chunk_size
    timings: dict[Any, Timing] = interleaved(calls, repeats)
    return {
        backend: {"least": steps[backend] / timing.least, "median": steps[backend] / timing.median}
        for backend, timing in timings.items()
    }


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("--num-envs", type=int, default=32, help="copies of each environment")
    parser.add_argument("--repeats", type=int, default=20, help="of every variant, in turns")
    given = parser.parse_args()
    results = {}
    table = Table("environment", "steps/s", "", "its twin, steps/s", "", "ratio")
    for env, twins in TWINS.items():
        rates = steps_per_second(env, given.num_envs, given.repeats)
        ours, theirs = (rates[backend]["least"] for backend in twins)
        results[env] = {"steps_per_second": rates, "ratio": ours / theirs}
        table.add_row(env, f"{ours:,.0f}", twins[0], f"{theirs:,.0f}", twins[1], f"{ours / theirs:.3g}")
    Console().print(table)
    settings = {"depth": DEPTH, "num_envs": given.num_envs, "repeats": given.repeats}
    print(write("worlds", {"settings": settings, "environments": results}))


if __name__ == "__main__":
    main()
