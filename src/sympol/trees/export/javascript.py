"""A tree as JavaScript: an ES module without imports, for a page, for Node, for Deno.

Names come from strangers. They stand in string literals and in line comments, in ASCII, and so that they cannot end a
``<script>`` in which the program may stand.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..base import BaseTree
from ..floats import number, unflushed_threshold
from ..text import node_words
from .common import (
    Answers,
    Step,
    answers,
    branch_words,
    comment,
    filled,
    legend,
    nested_ifs,
    table,
)
from .formats import check_style
from .toolchain import Run, compile_and_run, find_program

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float32

_HEAD = """\
// A decision tree policy, written by sympol: an ES module that needs nothing.
//
{legend}
//
// {comparisons} comparisons, at most {depth} a call. Observations are rounded to float32, as the tree's are.

export const FEATURES = [
{features},
];
"""

_ACT = """
/** The action of the tree for an array of numbers, one a feature. */
export function act(x) {{
  if (x.length !== {n}) {{
    throw new RangeError("expected {n} numbers, " + FEATURES.join(", ") + "; got " + x.length);
  }}
{body}}}
"""

_GROUPS = """
// of each group one feature is 1 and the others are 0
const GROUPS = [
{groups},
];

function check(x) {{
  for (const {{ name, features }} of GROUPS) {{
    const values = features.map((feature) => Math.fround(x[feature]));
    // as to the tree, a number below float32's normal range is 0
    const zeros = values.filter((value) => Math.abs(value) < 2 ** -126).length;
    if (!values.includes(1) || zeros !== values.length - 1) {{
      throw new RangeError(JSON.stringify(name) + " must be a single 1 and otherwise 0, got " + values.join(", "));
    }}
  }}
}}
"""

_LOOP = """\
  let node = 0;
  do {
    node = CHILD[2 * node + (Math.fround(x[FEATURE[node]]) <= THRESHOLD[node] ? 0 : 1)];
  } while (node >= 0);
"""


def to_javascript(tree: BaseTree, *, style: str = "ifs") -> str:
    """Write a module whose ``act`` acts as `DecisionTree.predict` does on every observation, to the bit.

    An action is a number where actions are discrete, an array of them for several components, and a flat array of
    numbers, in C order, where they are continuous. ``act`` throws a RangeError for an array of another length and,
    as the tree does, where a group of features is not one-hot.

    Args:
        tree: What is written.
        style: ``"ifs"``, or ``"table"``: typed arrays and a loop.

    Returns:
        The text of the module.

    Raises:
        ValueError: if the style is none, or an action has no number in JavaScript.
    """
    check_style("javascript", style)
    rows = answers(tree)
    as_table = style == "table" and tree.n_nodes > 1
    body = _loop(rows) if as_table else _ifs(tree, rows)
    head = _HEAD.format(
        legend="\n".join(f"// {line}" for line in legend(tree)),
        comparisons=tree.n_leaves - 1,
        depth=tree.depth,
        features=",\n".join(f"  {_string(name)}" for name in tree.feature_names),
    )
    groups = ""
    if tree.groups:
        lines = (f"  {{ name: {_string(g.name)}, features: {list(g.features)} }}" for g in tree.groups)
        groups, body = _GROUPS.format(groups=",\n".join(lines)), "  check(x);\n" + body
    act = _ACT.format(n=tree.n_features, body=body)
    return head + groups + (_tables(tree, rows) if as_table else "") + act


def _ifs(tree: BaseTree, rows: Answers) -> str:
    def head(step: Step) -> str:
        # a decimal of few digits is another double; rounded to float32 it is the threshold
        threshold = number(unflushed_threshold(tree.threshold[step.node]))
        asked = f"Math.fround(x[{tree.feature[step.node]}]) <= Math.fround({threshold})"
        asked = asked if step.side == "left" else f"!({asked})"
        return f"if ({asked}) {{ // {comment(branch_words(tree, step))}"

    def answer(leaf: int) -> list[str]:
        return [f"return {_answer(rows.of(leaf), rows)}; // {comment(node_words(tree, leaf))}"]

    return nested_ifs(tree, "  ", head, "}", answer)


def _tables(tree: BaseTree, rows: Answers) -> str:
    loop = table(tree, rows)
    children = [child for both in loop.child for child in both]
    typed = "Int16Array" if -(2**15) <= min(children) <= max(children) < 2**15 else "Int32Array"
    small = "Uint8Array" if tree.n_features <= 2**8 else "Uint32Array"
    return (
        f"\nconst THRESHOLD = {_typed('Float32Array', map(number, loop.threshold))};\n"
        f"const FEATURE = {_typed(small, loop.feature)};\n"
        f"const CHILD = {_typed(typed, children)};\n"
        f"const ANSWER = [\n{filled((_answer(row, rows) for row in rows.rows.tolist()), '  ')},\n];\n"
    )


def _typed(kind: str, items: Iterable[object]) -> str:
    return f"new {kind}([\n{filled(items, '  ')},\n])"


def _loop(rows: Answers) -> str:
    # a copy: what a caller does to its action must not change the policy
    return _LOOP + f"  return ANSWER[~node]{'' if rows.single else '.slice()'};\n"


def _answer(answer: list[int] | list[float], rows: Answers) -> str:
    return repr(answer[0] if rows.single else answer)


def _string(name: str) -> str:
    return json.dumps(name).replace("<", "\\u003c").replace(">", "\\u003e")


_MAIN = """\
import {{ readFileSync, writeSync }} from "node:fs";
import {{ act }} from "./policy.mjs";

const bytes = readFileSync(0);
const numbers = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
const x = [];
for (let i = 0; i < numbers.length; i += {n_features}) x.push(Array.from(numbers.subarray(i, i + {n_features})));
let actions = new Array(x.length);
for (let round = 0; round < Number(process.argv[3]); round++) {{
  const start = process.hrtime.bigint();
  for (let i = 0; i < x.length; i++) actions[i] = act(x[i]);
  console.error((Number(process.hrtime.bigint() - start) / 1e9).toFixed(9));
}}
const written = Buffer.from({array}.from(actions.flat(){convert}).buffer);
for (let at = 0; at < written.length; ) at += writeSync(1, written, at);
"""


def run_javascript(
    tree: BaseTree, x: Float32[np.ndarray, "batch features"], rounds: int, *, style: str = "ifs"
) -> Run:
    """Run the module with a program around it in Node on observations: see `sympol.trees.export.check`."""
    rows = answers(tree)
    array, convert = ("Float32Array", "") if rows.is_float else ("BigInt64Array", ".map(BigInt)")
    main = _MAIN.format(n_features=tree.n_features, array=array, convert=convert)
    files = {"policy.mjs": to_javascript(tree, style=style), "main.mjs": main}
    start = [find_program("node", "nodejs"), "main.mjs"]
    return compile_and_run(files, [], start, x, rounds, rows.rows.dtype)
