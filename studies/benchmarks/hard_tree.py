"""hard_tree beside autodiff of the textbook product and an MLP: python -m studies.benchmarks.hard_tree

Two ways to time a value-and-gradient, variants in turns, the least of many repeats of each:
  call   one jitted value_and_grad called from Python, dispatch included;
  step   one step of gradient descent inside a compiled loop, as training runs it (nothing of a step can be hoisted out
         of the loop: its parameters are the last step's result).

How far from the machine's limits: the least bytes and operations that the algorithm needs (`work`) over what a
stream, a chain of dependent-free gathers and a large matrix product reach on this machine in the same run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from rich.console import Console
from rich.table import Table
from studies.benchmarks.timing import Timing, arguments_of, compile_seconds, interleaved, write
from tests.functional.oracle import random_tree, textbook_tree

from sympol.functional import hard_tree

ACTIONS = 2
ROWS = [(7, 64, 4), (7, 512, 4), (7, 4096, 4), (7, 512, 147), (9, 512, 8), (11, 512, 4)]
TARGETS = {(7, 64, 4): 8, (7, 512, 4): 12, (9, 512, 8): 120, (11, 512, 4): 400, (7, 512, 147): 8}
MICRO_BATCHES = [(depth, batch, 4) for depth in (5, 7) for batch in (256, 512, 1024, 2048)]

Loss = Callable[[Any], Array]


def losses(depth: int, batch: int, features: int) -> dict[str, tuple[Loss, Any]]:
    """The variants: a loss of the parameters, and the parameters."""
    arrays = [jnp.asarray(a) for a in random_tree(0, depth, features, ACTIONS, batch)]
    tree, x = tuple(arrays[:3]), arrays[3]
    w = jnp.asarray(np.random.default_rng(1).normal(size=(batch, ACTIONS)), jnp.float32)
    keys = jax.random.split(jax.random.key(0), 3)
    sizes = (features, 64, 64, ACTIONS)
    mlp = [
        (jax.random.normal(key, (i, o)) / i**0.5, jnp.zeros((1, o)))
        for key, i, o in zip(keys, sizes, sizes[1:], strict=False)
    ]

    def mlp_loss(layers: Any) -> Array:
        h = x
        for i, (weight, bias) in enumerate(layers):
            h = h @ weight + bias
            h = jnp.tanh(h) if i < 2 else h
        return jnp.sum(h * w)

    return {
        "textbook": (lambda p: jnp.sum(textbook_tree(p[0], p[1], p[2], x) * w), tree),
        "hard_tree": (lambda p: jnp.sum(hard_tree(p[0], p[1], p[2], x) * w), tree),
        "mlp": (mlp_loss, mlp),
    }


def called(loss: Loss, parameters: Any) -> Callable[[], Any]:
    compiled = jax.jit(jax.value_and_grad(loss))
    return lambda: compiled(parameters)


def stepped(loss: Loss, parameters: Any, steps: int) -> Callable[[], Any]:
    def step(_: int, carry: Any) -> Any:
        p, total = carry
        value, gradient = jax.value_and_grad(loss)(p)
        return jax.tree.map(lambda a, g: a - 1e-6 * g, p, gradient), total + value

    compiled = jax.jit(lambda p: jax.lax.fori_loop(0, steps, step, (p, jnp.zeros(()))))
    return lambda: compiled(parameters)


def gradient_error(depth: int, batch: int, features: int) -> float:
    """The largest relative distance (Frobenius) from float64 autodiff of the textbook product, both surrogates."""
    arrays = random_tree(0, depth, features, ACTIONS, batch)
    w = np.random.default_rng(1).normal(size=(batch, ACTIONS))
    worst = 0.0
    for surrogate in ("sigmoid", "softsign"):

        def gradient(tree: Any, dtype: Any, surrogate: str = surrogate) -> list[np.ndarray]:
            *p, x = (jnp.asarray(a, dtype) for a in arrays)
            weight = jnp.asarray(w, jnp.float32).astype(dtype)
            loss = jax.jit(jax.grad(lambda p: jnp.sum(tree(*p, x, surrogate=surrogate) * weight)))
            return [np.asarray(g, np.float64) for g in loss(p)]

        ours = gradient(hard_tree, jnp.float32)
        with jax.enable_x64(True):
            exact = gradient(textbook_tree, jnp.float64)
        worst = max(
            worst,
            *(float(np.linalg.norm(a - b) / np.linalg.norm(b)) for a, b in zip(ours, exact, strict=True)),
        )
    return worst


def work(depth: int, batch: int, features: int) -> dict[str, float]:
    """What one value-and-gradient cannot do without, counted by hand from the algorithm.

    gathers: three for each comparison, D down the path and D(D − 1)/2 for the siblings, and A for each leaf met.
    bytes: parameters and observations read once, gradients written once (nothing in between counted).
    flops: D·(F + 1) multiply-adds an observation for the sums, A for each of D + 1 leaves, 12 for S′, and
    entmax15's derivative (6 Newton steps of 4, and 8) for each of N·F.
    """
    nodes, comparisons = 2**depth - 1, depth + depth * (depth - 1) // 2
    return {
        "gathers": batch * (3 * comparisons + ACTIONS * (depth + 2)),
        "bytes": 4 * (4 * nodes * features + 2 * (nodes + 1) * ACTIONS + batch * (features + 2 * ACTIONS)),
        "flops": batch * (2 * depth * (features + 1) + 2 * ACTIONS * (depth + 1) + 12 * depth)
        + 32 * nodes * features,
    }


def limits() -> dict[str, float]:
    """What this machine reaches with JAX, everything in cache where ours is: gathers, bytes and flops a second."""
    table = jnp.arange(2048.0)
    index = jnp.asarray(np.random.default_rng(0).integers(0, 2048, 1 << 16), jnp.uint32)
    stream = jnp.ones(1 << 25)
    matrix = jnp.ones((1024, 1024))

    def many_gathers(table: Array) -> Array:
        def once(_: int, table: Array) -> Array:
            picked = table.at[index].get(mode="promise_in_bounds")
            return table + jnp.sum(picked.reshape(32, -1), 0)

        return jax.lax.fori_loop(0, 20, once, table)

    timings = interleaved(
        {
            "gather": _jitted(many_gathers, table),
            "stream": _jitted(lambda a: jax.lax.fori_loop(0, 4, lambda _, a: a + 1.0, a), stream),
            "matmul": _jitted(lambda a: a @ a, matrix),
        }
    )
    return {
        "gathers": 20 * index.size / timings["gather"].least,
        "bytes": 4 * 2 * 4 * stream.size / timings["stream"].least,
        "flops": 2 * 1024**3 / timings["matmul"].least,
    }


def _jitted(function: Callable[[Array], Array], argument: Array) -> Callable[[], Array]:
    compiled = jax.jit(function)
    return lambda: compiled(argument)


def measure(depth: int, batch: int, features: int, repeats: int) -> dict[str, Any]:
    variants = losses(depth, batch, features)
    steps = {name: max(1, 20_000 // (batch * depth)) for name in variants}
    steps["textbook"] = max(1, 1_000_000 // (batch * depth * 2**depth))
    call = interleaved({n: called(*v) for n, v in variants.items()}, repeats)
    step = interleaved({n: stepped(*v, steps[n]) for n, v in variants.items()}, repeats)
    per_step = {n: Timing(*(t / steps[n] for t in timing)) for n, timing in step.items()}
    trace, compiled = compile_seconds(jax.value_and_grad(variants["hard_tree"][0]), variants["hard_tree"][1])
    return {
        "depth": depth,
        "batch": batch,
        "features": features,
        "actions": ACTIONS,
        "call_us": {n: [round(1e6 * t, 2) for t in timing] for n, timing in call.items()},
        "step_us": {n: [round(1e6 * t, 2) for t in timing] for n, timing in per_step.items()},
        "call_ratio": call["textbook"].least / call["hard_tree"].least,
        "step_ratio": per_step["textbook"].least / per_step["hard_tree"].least,
        "step_mlp_ratio": per_step["mlp"].least / per_step["hard_tree"].least,
        "call_mlp_ratio": call["mlp"].least / call["hard_tree"].least,
        "target": TARGETS.get((depth, batch, features)),
        "gradient_error": gradient_error(depth, batch, features),
        "trace_seconds": trace,
        "compile_seconds": compiled,
        "work": work(depth, batch, features),
    }


def micro_batches(repeats: int) -> list[dict[str, Any]]:
    """What one minibatch costs by its size: how small may training make them?"""
    rows = []
    for depth, batch, features in MICRO_BATCHES:
        steps = max(1, 40_000 // (batch * depth))
        variants = {
            n: stepped(*v, steps) for n, v in losses(depth, batch, features).items() if n != "textbook"
        }
        timing = interleaved(variants, repeats)
        rows.append(
            {"depth": depth, "batch": batch, "features": features}
            | {f"{name}_us": round(1e6 * t.least / steps, 2) for name, t in timing.items()}
        )
    return rows


def main() -> None:
    parser = arguments_of(__doc__)
    parser.add_argument("--repeats", type=int, default=40, help="of every variant, in turns")
    arguments = parser.parse_args()

    reached = limits()
    rows = []
    for row in ROWS:
        result = measure(*row, arguments.repeats)
        seconds = result["step_us"]["hard_tree"][0] * 1e-6
        result["share_of_limit"] = {k: v / reached[k] / seconds for k, v in result["work"].items()}
        rows.append(result)
    small = micro_batches(arguments.repeats)
    path = write("hard_tree", {"limits_per_second": reached, "rows": rows, "micro_batches": small})
    show(rows, small, reached)
    Console().print(f"written to {path}")


def show(rows: list[dict[str, Any]], small: list[dict[str, Any]], reached: dict[str, float]) -> None:
    console = Console(width=150)
    table = Table(title="value and gradient, µs (call from Python | step in a compiled loop)")
    columns = (
        "depth, batch, features",
        "textbook + autodiff",
        "hard_tree",
        "MLP 2×64",
        "× textbook",
        "target",
        "× MLP",
    )
    for column in (*columns, "gradient error", "compile s", "share of the gathers | flops"):
        table.add_column(column, justify="right")
    for row in rows:
        call, step, share = row["call_us"], row["step_us"], row["share_of_limit"]
        table.add_row(
            f"{row['depth']}, {row['batch']}, {row['features']}",
            *(f"{call[n][0]:,.0f} | {step[n][0]:,.0f}" for n in ("textbook", "hard_tree", "mlp")),
            f"{row['call_ratio']:.0f} | {row['step_ratio']:.0f}",
            f"{row['target'] or ''}",
            f"{row['call_mlp_ratio']:.1f} | {row['step_mlp_ratio']:.1f}",
            f"{row['gradient_error']:.0e}",
            f"{row['trace_seconds'] + row['compile_seconds']:.2f}",
            f"{share['gathers']:.0%} | {share['flops']:.1%}",
        )
    console.print(table)
    table = Table(title="one step by the size of its batch, µs")
    for column in ("depth", "batch", "hard_tree", "µs / observation", "MLP 2×64"):
        table.add_column(column, justify="right")
    for row in small:
        each = row["hard_tree_us"] / row["batch"]
        table.add_row(
            f"{row['depth']}",
            f"{row['batch']}",
            f"{row['hard_tree_us']:.1f}",
            f"{each:.3f}",
            f"{row['mlp_us']:.1f}",
        )
    console.print(table)
    console.print(
        f"this machine: {reached['gathers'] / 1e9:.1f} G gathers/s (in cache), {reached['bytes'] / 1e9:.1f} GB/s "
        f"streamed, {reached['flops'] / 1e9:.0f} Gflop/s in a matrix product"
    )


if __name__ == "__main__":
    main()
