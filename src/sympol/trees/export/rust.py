"""A tree as Rust: a crate without std and without dependencies, or a module of yours.

Names come from strangers. In Rust they stand in line comments, in ASCII.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base import BaseTree
from ..floats import shortest, unflushed_threshold
from ..text import node_words
from .common import Answers, Step, answers, branch_words, comment, filled, legend, nested_ifs
from .toolchain import Run, compile_and_run, find_program

if TYPE_CHECKING:
    from jaxtyping import Float32

STRICT = ("--edition", "2021", "-D", "warnings")
"""The compiler options under which the file compiles without a warning."""

_HEAD = """\
// A decision tree policy, written by sympol: Rust, no_std, no dependencies, no unsafe code. It is a crate of its own;
// as a module of another one it needs the two lines #![...] no more.
//
{legend}
//
// {comparisons} comparisons, at most {depth} a call.
#![no_std]
#![forbid(unsafe_code)]

"""

_VALID = """
/// Whether the tree accepts x: of each group one feature is 1 and the others are 0. Where it does not, what
/// `act` returns means nothing.
pub fn is_valid(x: &[f32; {n}]) -> bool {{
{groups}
    {checks}
}}

/// Whether one of these features is 1 and the others are 0, as which the subnormal numbers count.
fn one_hot(x: &[f32; {n}], features: &[usize]) -> bool {{
    let mut ones = 0;
    for &feature in features {{
        let value = x[feature];
        if value == 1.0 {{
            ones += 1;
        }} else if value != 0.0 && !value.is_subnormal() {{
            return false;
        }}
    }}
    ones == 1
}}
"""


def to_rust(tree: BaseTree) -> str:
    """Write a Rust file whose ``act`` acts as `DecisionTree.predict` does on every observation, to the bit.

    ``pub fn act(x: &[f32; N]) -> i32`` where actions are discrete (``i64`` where they are too large), ``-> [i32; K]``
    for several components, and ``-> [f32; M]``, clipped, in C order, where they are continuous. Where there are
    one-hot groups, ``pub fn is_valid(x: &[f32; N]) -> bool`` says whether the tree accepts x.

    Args:
        tree: The tree to write.

    Returns:
        The text of the file.

    Raises:
        ValueError: if an action has no number in Rust.
    """
    rows = answers(tree)
    n, kind = tree.n_features, answer_type(rows)
    answer = kind if rows.single else f"[{kind}; {rows.n_outputs}]"
    x = "x" if tree.n_nodes > 1 else "_x"
    head = _HEAD.format(
        legend="\n".join(f"// {line}" for line in legend(tree)),
        comparisons=tree.n_leaves - 1,
        depth=tree.depth,
    )
    act = (
        f"/// The action of the tree for an observation.\n"
        f"pub fn act({x}: &[f32; {n}]) -> {answer} {{\n{_ifs(tree, rows)}}}\n"
    )
    return head + act + _valid(tree)


def _valid(tree: BaseTree) -> str:
    if not tree.groups:
        return ""
    groups = "\n".join(
        f"    let group_{i} = [\n{filled(group.features, ' ' * 8)},\n    ];"
        for i, group in enumerate(tree.groups)
    )
    checks = " && ".join(f"one_hot(x, &group_{i})" for i in range(len(tree.groups)))
    return _VALID.format(n=tree.n_features, groups=groups, checks=checks)


def answer_type(rows: Answers) -> str:
    """The type of an answer's numbers."""
    small = not rows.is_float and -(2**31) <= rows.rows.min() <= rows.rows.max() < 2**31
    return "f32" if rows.is_float else "i32" if small else "i64"


def _ifs(tree: BaseTree, rows: Answers) -> str:
    def head(step: Step) -> str:
        asked = f"x[{tree.feature[step.node]}] <= {_float(unflushed_threshold(tree.threshold[step.node]))}"
        asked = asked if step.side == "left" else f"!({asked})"
        return f"if {asked} {{ // {comment(branch_words(tree, step))}"

    def answer(leaf: int) -> list[str]:
        numbers = [_float(x) if isinstance(x, float) else str(x) for x in rows.of(leaf)]
        value = numbers[0] if rows.single else f"[{', '.join(numbers)}]"
        return [f"return {value}; // {comment(node_words(tree, leaf))}"]

    return nested_ifs(tree, "    ", head, "}", answer)


def _float(x: float) -> str:
    """A float32 in the fewest digits; Rust rounds what it reads to the nearest float32."""
    return repr(shortest(x))


_MAIN = """\
#[path = "policy.rs"]
#[allow(dead_code, unused_attributes)]
mod policy;
use std::io::{{Read, Write}};

fn main() {{
    let rounds: usize = std::env::args().nth(2).unwrap().parse().unwrap();
    let mut bytes = Vec::new();
    std::io::stdin().read_to_end(&mut bytes).unwrap();
    let numbers: Vec<f32> = bytes
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect();
    let x: Vec<[f32; {n_features}]> = numbers
        .chunks_exact({n_features})
        .map(|row| <[f32; {n_features}]>::try_from(row).unwrap())
        .collect();
    let mut actions = Vec::new();
    for _ in 0..rounds {{
        actions.clear();
        actions.reserve(x.len());
        let start = std::time::Instant::now();
        for row in &x {{
            actions.push(policy::act(row));
        }}
        eprintln!("{{:.9}}", start.elapsed().as_secs_f64());
    }}
    let mut written = Vec::new();
    for action in &actions {{
        {write}
    }}
    std::io::stdout().write_all(&written).unwrap();
}}
"""


def run_rust(tree: BaseTree, x: Float32[np.ndarray, "batch features"], rounds: int) -> Run:
    """Compile the Rust file with a program around it, and run that on observations: see `sympol.trees.export.check`."""
    rows = answers(tree)
    number = "written.extend_from_slice(&{}.to_le_bytes());"
    write = number.format("action") if rows.single else f"for part in action {{ {number.format('part')} }}"
    files = {"policy.rs": to_rust(tree), "main.rs": _MAIN.format(n_features=tree.n_features, write=write)}
    build = [find_program("rustc", "rustc"), *STRICT, "-O", "main.rs"]
    dtype = {"f32": np.float32, "i32": np.int32, "i64": np.int64}[answer_type(rows)]
    return compile_and_run(files, build, ["./main"], x, rounds, dtype)
