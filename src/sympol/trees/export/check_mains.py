"""Programs around an exported policy: float32 rows from the standard input, through `act`, to the standard output.

Their arguments are the number of rows and of rounds through them; the seconds of each round go to the error stream.
"""

from __future__ import annotations

_C_MAIN = """\
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

_RUST_MAIN = """\
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

_JAVASCRIPT_MAIN = """\
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


def c(n_features: int, n_outputs: int, kind: str, single: bool) -> str:
    """A C program that includes policy.c; it writes numbers of this type, those of a row side by side."""
    x, action = f"x + i * {n_features}", f"action + i * {n_outputs}"
    act = f"action[i] = policy_act({x})" if single else f"policy_act({x}, {action})"
    return _C_MAIN.format(n_features=n_features, n_outputs=n_outputs, kind=kind, act=act)


def rust(n_features: int, single: bool) -> str:
    """A Rust program with policy.rs as a module."""
    number = "written.extend_from_slice(&{}.to_le_bytes());"
    write = number.format("action") if single else f"for part in action {{ {number.format('part')} }}"
    return _RUST_MAIN.format(n_features=n_features, write=write)


def javascript(n_features: int, is_float: bool) -> str:
    """A program for Node that imports policy.mjs; it writes float32 or int64."""
    array, convert = ("Float32Array", "") if is_float else ("BigInt64Array", ".map(BigInt)")
    return _JAVASCRIPT_MAIN.format(n_features=n_features, array=array, convert=convert)
