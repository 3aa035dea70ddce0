"""What a decision costs in each form a tree is exported to, side by side over a million visited observations.

    python -m studies.benchmarks.exports [RUN] [--sb3]

RUN holds a tree of CartPole-v1; without one, one is trained (about 20 s). The observations are those the tree meets
in a million steps of Gymnasium's CartPole. In ten turns, so that a busy machine meets all, each form goes through a
tenth of them, in rounds short enough that most are not interrupted; what takes microseconds a call through some
hundreds. Every action is compared with the tree's. With --sb3 stable-baselines3's untrained MLP of the
usual size answers one observation a call, too. Writes studies/results/exports.json and the table in
docs/guides/exports.md.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table

import sympol
from sympol.runs.run import Run
from sympol.trees import DecisionTree
from sympol.trees.export.check import run

from .rivals.environment import interpreter
from .timing import ROOT, arguments_of, write

ENV = "CartPole-v1"
N_ENVS = 500
N = 1_000_000
TURNS, ROUNDS = 10, 10
CHUNK = 10_000
"""Decisions timed at once."""
FEW = 200
"""Rows of a turn for what is slow."""
MARKS = "<!-- written by studies/benchmarks/exports.py -->", "<!-- until here -->"

COMPILERS = {
    "x86-64": ("cc", "size", []),
    "Cortex-M0+": ("arm-none-eabi-gcc", "arm-none-eabi-size", ["-mcpu=cortex-m0plus", "-mthumb", "-ffreestanding"]),
    "AVR (ATmega328P)": ("avr-gcc", "avr-size", ["-mmcu=atmega328p"]),
}  # fmt: skip

SB3 = """
import sys, time, json
import numpy as np
import stable_baselines3, torch
torch.set_num_threads(1)
model = stable_baselines3.PPO("MlpPolicy", "CartPole-v1", device="cpu", seed=0)
rows = np.frombuffer(sys.stdin.buffer.read(), np.float32).reshape(-1, 4)
rounds = []
for _ in range(6):
    start = time.perf_counter()
    for row in rows:
        model.predict(row, deterministic=True)
    rounds.append((time.perf_counter() - start) / len(rows))
versions = {"stable-baselines3": stable_baselines3.__version__, "torch": torch.__version__}
print(json.dumps({"seconds": rounds[1:], "versions": versions}))
"""


def visited(tree: DecisionTree) -> np.ndarray:
    """The observations of a million steps, float32 [N, 4], as the tree acts."""
    envs = gymnasium.make_vec(ENV, N_ENVS, vectorization_mode="vector_entry_point")
    x, _ = envs.reset(seed=0)
    met = []
    for _ in range(N // N_ENVS):
        met.append(x.copy())
        x, *_ = envs.step(tree.predict(x))
    envs.close()
    return np.concatenate(met).astype(np.float32)


def each(act: Callable[[Any], Any], rows: Any, expected: np.ndarray) -> list[float]:
    """Seconds a decision of each round, one call a row; ends where an action is not the tree's."""
    acted = [act(row) for row in rows]
    assert (np.array(acted).ravel() == expected[: len(acted)].ravel()).all()
    seconds = []
    for i in range(0, len(rows), CHUNK):
        chunk = rows[i : i + CHUNK]
        start = time.perf_counter()
        for row in chunk:
            act(row)
        seconds.append((time.perf_counter() - start) / len(chunk))
    return seconds


def whole(tree: DecisionTree, to: str, x: np.ndarray, expected: np.ndarray, **options: str) -> list[float]:
    """The same of a program that goes through all rows by itself; its first round warms it up."""
    ran = run(tree, to, x, rounds=ROUNDS + 1, **options)
    assert (ran.actions.ravel() == expected.ravel()).all()
    return [seconds / len(x) for seconds in ran.seconds[1:]]


def variants(tree: DecisionTree, x: np.ndarray, python: str | None) -> dict[str, Callable[[], list[float]]]:
    """What is compared, by its name for people."""
    import onnxruntime

    expected = tree.predict(x)
    namespace: dict[str, Any] = {"__name__": "policy"}
    exec(tree.to_python(), namespace)
    act, lists, few = namespace["act"], x.tolist(), list(x[:FEW])
    estimator = tree.to_sklearn(names=False)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(tree.export("onnx"), options, providers=["CPUExecutionProvider"])
    found: dict[str, Callable[[], list[float]]] = {
        "C, ifs": lambda: whole(tree, "c", x, expected, style="ifs"),
        "C, table": lambda: whole(tree, "c", x, expected, style="table"),
        "Rust": lambda: whole(tree, "rust", x, expected),
        "JavaScript, ifs": lambda: whole(tree, "javascript", x, expected, style="ifs"),
        "JavaScript, table": lambda: whole(tree, "javascript", x, expected, style="table"),
        "Python file, lists": lambda: each(act, lists, expected),
        "Python file, NumPy rows": lambda: each(act, list(x[:CHUNK]), expected),
        "SQLite, a query": lambda: whole(tree, "sql", x[:CHUNK], expected[:CHUNK], style="sqlite"),
        "onnxruntime, batch": lambda: whole(tree, "onnx", x, expected),
        "onnxruntime, one row": lambda: each(
            lambda row: session.run(None, {"observation": row[None]})[0], few, expected
        ),
        "tree.predict, batch": lambda: batch(tree, x),
        "tree.predict, one row": lambda: each(tree.predict, few, expected),
        "scikit-learn predict, one row": lambda: each(
            lambda row: estimator.predict(row[None]), few, expected
        ),
    }
    if python is not None:
        found["stable-baselines3 predict, one row"] = lambda: sb3(python, x[:FEW])["seconds"]
    return found


def batch(tree: DecisionTree, x: np.ndarray) -> list[float]:
    start = time.perf_counter()
    tree.predict(x)
    return [(time.perf_counter() - start) / len(x)]


def sb3(python: str, x: np.ndarray) -> dict[str, Any]:
    done = subprocess.run(
        [python, "-W", "ignore", "-c", SB3], input=x.tobytes(), capture_output=True, check=True
    )
    return json.loads(done.stdout.decode().splitlines()[-1])


def code_sizes(tree: DecisionTree) -> dict[str, dict[str, int]]:
    """Bytes of code and constants of the C file at -Os, without the compiler's own routines for floats."""
    sizes: dict[str, dict[str, int]] = {}
    for machine, (compiler, size, flags) in COMPILERS.items():
        if shutil.which(compiler) is None:
            continue
        for style in ("ifs", "table"):
            with tempfile.TemporaryDirectory() as folder:
                Path(folder, "policy.c").write_text(str(tree.export("c", style=style)))
                subprocess.run(
                    [compiler, "-std=c99", "-Os", *flags, "-c", "policy.c"], cwd=folder, check=True
                )
                done = subprocess.run(
                    [size, "policy.o"], cwd=folder, capture_output=True, text=True, check=True
                )
            text, data, bss = map(int, done.stdout.splitlines()[1].split()[:3])
            sizes.setdefault(machine, {})[style] = text + data + bss
    return sizes


def markdown(content: dict[str, Any]) -> str:
    """The tables of docs/guides/exports.md."""
    size, machine = content["tree"], content["machine"]
    lines = [
        f"Medians over {content['observations']:,} observations that a tree of {size['nodes']} nodes, depth "
        f"{size['depth']}, meets in CartPole-v1, in one run (`python -m studies.benchmarks.exports`; "
        f"{machine['cores']} cores, load {machine['load'][0]:g}, {machine['cpu'].split(' (')[0]}):",
        "",
        "| | ns a decision | least of all rounds |",
        "|---|---:|---:|",
        *(
            f"| {name} | {figures(found['median_ns'])} | {figures(found['least_ns'])} |"
            for name, found in content["decision"].items()
        ),
        "",
        "Bytes of the C file's code and tables at `-Os`, without the compiler's own routines for floats:",
        "",
        "| | ifs | table |",
        "|---|---:|---:|",
        *(f"| {name} | {found['ifs']} | {found['table']} |" for name, found in content["code_bytes"].items()),
    ]
    return "\n".join(lines)


def figures(ns: float) -> str:
    return f"{ns:,.0f}" if ns >= 100 else f"{ns:.1f}"


def put_in_page(content: dict[str, Any], page: Path) -> None:
    """Replace what is between the marks."""
    before, _, rest = page.read_text(encoding="utf-8").partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    text = f"{before}{MARKS[0]}\n{markdown(content)}\n{MARKS[1]}{after}"
    page.write_text(text, encoding="utf-8")


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("run", nargs="?", type=Path)
    parser.add_argument("--sb3", action="store_true", help="measure stable-baselines3 as well")
    given = parser.parse_args()
    python = str(interpreter("sb3")) if given.sb3 else None
    if given.run is not None:
        tree = Run.open(given.run).load_tree()
    else:
        tree = sympol.PPO("tree", ENV, seed=1).learn(progress_bar=False).tree()
    x = visited(tree)
    measured: dict[str, list[float]] = {}
    for turn in range(TURNS):
        for name, measure in variants(tree, x[turn::TURNS], python).items():
            measured.setdefault(name, []).extend(measure())
    table = Table("", "ns a decision", "least", "decisions a second")
    results = {}
    for name, seconds in measured.items():
        ns, least = 1e9 * median(seconds), 1e9 * min(seconds)
        results[name] = {"median_ns": round(ns, 2), "least_ns": round(least, 2)}
        table.add_row(name, f"{ns:,.1f}", f"{least:,.1f}", f"{1e9 / ns:,.0f}")
    tree_size = {"nodes": tree.n_nodes, "depth": tree.depth, "features": tree.n_features}
    sizes = code_sizes(tree)
    Console().print(table, sizes)
    content = {"tree": tree_size, "observations": len(x), "decision": results, "code_bytes": sizes}
    if python is not None:
        content["stable_baselines3"] = sb3(python, x[:10])["versions"]
    path = write("exports", content)
    put_in_page(json.loads(path.read_text(encoding="utf-8")), ROOT / "docs" / "guides" / "exports.md")
    print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()
