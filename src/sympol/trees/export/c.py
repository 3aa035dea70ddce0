"""A tree as C99: no allocation, no library, no double; it compiles for a microcontroller as for a desktop.

Names come from strangers. In C they stand in comments, in ASCII, where they cannot end them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..base import BaseTree
from ..floats import unflushed_threshold
from ..text import node_words
from .common import (
    Answers,
    Step,
    answers,
    branch_words,
    check_name,
    comment,
    filled,
    legend,
    nested_ifs,
    table,
)
from .formats import check_style
from .toolchain import Run, compile_and_run, find_program

if TYPE_CHECKING:
    from jaxtyping import Float32

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
"""The compiler options under which the file compiles without a warning."""
_BYTES = {"int8_t": 1, "uint8_t": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4, "int64_t": 8}

_HEAD = """\
/* A decision tree policy, written by sympol: C99, no allocation, no library.
 *
{legend}
 *
 * {comparisons} comparisons, at most {depth} a call; {size}.
 * NaN goes right, so do not compile with -ffast-math or -ffinite-math-only.{groups}
 */
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "the tree tells NaN from numbers: compile without -ffast-math and -ffinite-math-only"
#endif

#include <stdint.h>

{prototypes}
"""

_GROUPS = """
 * Some features are one-hot: where {name}_valid says 0, the tree refuses x, and the action means nothing."""

_LOOP = """\
    {node} node = 0;

    do {{
        node = {name}_child[node][!(x[{name}_feature[node]] <= {name}_threshold[node])];
    }} while (node >= 0);
"""

_VALID = """\
{tables}

/* whether one of these features is 1 and the others are 0, as which the subnormal numbers count */
static int {name}_one_hot(const float *x, const {index} *features, int n)
{{
    int ones = 0;
    int i;

    for (i = 0; i < n; i++) {{
        const float value = x[features[i]];

        if (value == 1.0f)
            ones++;
        else if (!(-0x1p-126f < value && value < 0x1p-126f))
            return 0;
    }}
    return ones == 1;
}}

int {name}_valid(const float x[{n}])
{{
    return {checks};
}}
"""


def to_c(tree: BaseTree, *, style: str = "ifs", name: str = "policy") -> str:
    """Write a C file whose ``NAME_act`` acts as `DecisionTree.predict` does on every observation, to the bit.

    ``int32_t NAME_act(const float x[N])`` where actions are discrete (``int64_t`` where they are too large),
    ``void NAME_act(const float x[N], int32_t action[K])`` for several components, and
    ``void NAME_act(const float x[N], float action[M])``, clipped, in C order, where they are continuous. Where
    there are one-hot groups, ``int NAME_valid(const float x[N])`` says whether the tree accepts x.

    Args:
        tree: What is written.
        style: ``"ifs"``, or ``"table"``: constant arrays and a loop.
        name: What names in the file begin with.

    Returns:
        The text of the file.

    Raises:
        ValueError: if style or name are none, or an action has no number in C.
    """
    check_style("c", style)
    name, rows = check_name(name), answers(tree)
    as_table = style == "table" and tree.n_nodes > 1
    tables, size = _tables(tree, rows, name) if as_table else ("", 0)
    body = _loop(tree, rows, name) if as_table else _ifs(tree, rows)
    if tree.n_nodes == 1:
        body = "    (void)x;\n" + body
    head = _HEAD.format(
        legend="\n".join(f" * {line}" for line in legend(tree)),
        comparisons=tree.n_leaves - 1,
        depth=tree.depth,
        size=f"{size} bytes of tables" if as_table else "no tables",
        groups=_GROUPS.format(name=name) if tree.groups else "",
        prototypes=_prototypes(tree, rows, name),
    )
    act = f"{_signature(tree, rows, name)}\n{{\n{body}}}\n"
    return "\n".join(part for part in (head, tables, act, _valid(tree, name)) if part)


def to_c_header(tree: BaseTree, *, name: str = "policy") -> str:
    """Write the header of the file that `to_c` writes under this name, for C and C++.

    Args:
        tree: The tree to write.
        name: The prefix of names in the file.

    Returns:
        The text of the file.
    """
    guard = f"{check_name(name).upper()}_H"
    prototypes = _prototypes(tree, answers(tree), name)
    return (
        f"/* A decision tree policy, written by sympol: declares what the C file of the same name defines. */\n"
        f"#ifndef {guard}\n#define {guard}\n\n#include <stdint.h>\n\n"
        f'#ifdef __cplusplus\nextern "C" {{\n#endif\n\n{prototypes}\n\n#ifdef __cplusplus\n}}\n#endif\n\n#endif\n'
    )


def _prototypes(tree: BaseTree, rows: Answers, name: str) -> str:
    valid = f"\nint {name}_valid(const float x[{tree.n_features}]);" if tree.groups else ""
    return f"{_signature(tree, rows, name)};{valid}"


def _signature(tree: BaseTree, rows: Answers, name: str) -> str:
    kind = answer_type(rows)
    x = f"const float x[{max(tree.n_features, 1)}]"  # C has no arrays of nothing
    if rows.single:
        return f"{kind} {name}_act({x})"
    return f"void {name}_act({x}, {kind} action[{rows.n_outputs}])"


def answer_type(rows: Answers) -> str:
    """The type of an answer, or of each number of it."""
    if rows.is_float:
        return "float"
    return "int32_t" if _integer_type(rows.rows.ravel()) != "int64_t" else "int64_t"


def _integer_type(numbers: Iterable[int] | np.ndarray) -> str:
    """The smallest signed type that holds these."""
    array = np.array(list(numbers), np.int64)
    fits = (
        bits for bits in (8, 16, 32) if -(2 ** (bits - 1)) <= array.min() <= array.max() < 2 ** (bits - 1)
    )
    return f"int{next(fits, 64)}_t"


def _index_type(n: int) -> str:
    """The smallest type that holds positions among n."""
    return f"uint{next(bits for bits in (8, 16, 32) if n <= 2**bits)}_t"


def _ifs(tree: BaseTree, rows: Answers) -> str:
    def head(step: Step) -> str:
        asked = f"x[{tree.feature[step.node]}] <= {_hex(unflushed_threshold(tree.threshold[step.node]))}"
        asked = asked if step.side == "left" else f"!({asked})"
        return f"if ({asked}) {{ /* {comment(branch_words(tree, step))} */"

    def answer(leaf: int) -> list[str]:
        literals, words = list(map(_literal, rows.of(leaf))), f"/* {comment(node_words(tree, leaf))} */"
        if rows.single:
            return [f"return {literals[0]}; {words}"]
        return [words, *(f"action[{i}] = {literal};" for i, literal in enumerate(literals)), "return;"]

    return nested_ifs(tree, "    ", head, "}", answer)


def _tables(tree: BaseTree, rows: Answers, name: str) -> tuple[str, int]:
    """The constant arrays, and how many bytes they take."""
    loop = table(tree, rows)
    feature, child = _index_type(tree.n_features), _integer_type(np.ravel(loop.child))
    answer = "float" if rows.is_float else _integer_type(rows.rows.ravel())
    n, n_rows = len(loop.feature), len(rows.rows)
    size = n * (4 + _BYTES[feature] + 2 * _BYTES[child]) + rows.rows.size * _BYTES.get(answer, 4)
    of = "" if rows.single else f"[{rows.n_outputs}]"
    literals = [[_literal(x) for x in row] for row in rows.rows.tolist()]
    answer_items = [row[0] if rows.single else f"{{{', '.join(row)}}}" for row in literals]
    arrays = [
        (f"float {name}_threshold[{n}]", map(_hex, loop.threshold)),
        (f"{feature} {name}_feature[{n}]", loop.feature),
        (f"{child} {name}_child[{n}][2]", (f"{{{left}, {right}}}" for left, right in loop.child)),
        (f"{answer} {name}_answer[{n_rows}]{of}", answer_items),
    ]
    return "\n".join(f"static const {what} = {{\n{filled(items)}\n}};\n" for what, items in arrays), size


def _loop(tree: BaseTree, rows: Answers, name: str) -> str:
    loop = _LOOP.format(node=_integer_type(np.ravel(table(tree, rows).child)), name=name)
    if rows.single:
        return f"{loop}    return {name}_answer[~node];\n"
    copies = (f"    action[{i}] = {name}_answer[~node][{i}];\n" for i in range(rows.n_outputs))
    return loop + "".join(copies)


def _valid(tree: BaseTree, name: str) -> str:
    if not tree.groups:
        return ""
    index, groups = _index_type(tree.n_features), [group.features for group in tree.groups]
    return _VALID.format(
        name=name,
        n=tree.n_features,
        index=index,
        tables="\n".join(
            f"static const {index} {name}_group_{i}[{len(features)}] = {{\n{filled(features)}\n}};"
            for i, features in enumerate(groups)
        ),
        checks="\n        && ".join(
            f"{name}_one_hot(x, {name}_group_{i}, {len(features)})" for i, features in enumerate(groups)
        ),
    )


def _literal(x: float) -> str:
    if isinstance(x, float):
        return _hex(x)
    # a plain literal is an int, which is 16 bits on some microcontrollers: C makes it long or long long itself
    return str(x)


def _hex(x: float) -> str:
    """A float as C99 writes it exactly: ``0x1.8p-3f``."""
    mantissa, exponent = x.hex().split("p")
    return f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}p{exponent}f"


_MAIN = """\
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "policy.c"

int main(int argc, char **argv)
{{
    const size_t n = strtoul(argv[1], NULL, 10);
    const int rounds = atoi(argv[2]);
    float *x = malloc((n ? n : 1) * {n_features} * sizeof *x);
    {kind} *action = malloc((n ? n : 1) * {n_outputs} * sizeof *action);

    if (argc != 3 || !x || !action || fread(x, {n_features} * sizeof *x, n, stdin) != n)
        return 1;
    for (int round = 0; round < rounds; round++) {{
        struct timespec start, stop;

        clock_gettime(CLOCK_MONOTONIC, &start);
        for (size_t i = 0; i < n; i++)
            {act};
        clock_gettime(CLOCK_MONOTONIC, &stop);
        fprintf(stderr, "%.9f\\n",
                (double)(stop.tv_sec - start.tv_sec) + 1e-9 * (double)(stop.tv_nsec - start.tv_nsec));
    }}
    return fwrite(action, {n_outputs} * sizeof *action, n, stdout) != n;
}}
"""


def run_c(
    tree: BaseTree, x: Float32[np.ndarray, "batch features"], rounds: int, *, style: str = "ifs"
) -> Run:
    """Compile the C file with a program around it, and run that on observations: see `sympol.trees.export.check`."""
    rows = answers(tree)
    kind, row, action = answer_type(rows), f"x + i * {tree.n_features}", f"action + i * {rows.n_outputs}"
    act = f"action[i] = policy_act({row})" if rows.single else f"policy_act({row}, {action})"
    main = _MAIN.format(n_features=tree.n_features, n_outputs=rows.n_outputs, kind=kind, act=act)
    files = {"policy.c": to_c(tree, style=style), "main.c": main}
    build = [find_program("cc", "gcc"), *STRICT, "-O2", "main.c", "-o", "main"]
    dtype = {"float": np.float32, "int32_t": np.int32, "int64_t": np.int64}[kind]
    return compile_and_run(files, build, ["./main"], x, rounds, dtype)
