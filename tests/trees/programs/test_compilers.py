"""What each language promises beside the actions: no warning, no library, sizes, what is accepted."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import pytest

from sympol import DecisionTree
from sympol.trees.export import c, rust
from sympol.trees.export.check import check_observations
from sympol.trees.floats import double_threshold

from ..samples import consistent
from .running import trees


@pytest.mark.parametrize("style", ["ifs", "table"])
@pytest.mark.parametrize(
    ("compiler", "package", "flags"),
    [
        ("cc", "gcc", ["-O2"]),
        ("cc", "gcc", ["-O0", "-Wconversion", "-Wshadow", "-Wstrict-prototypes"]),
        ("arm-none-eabi-gcc", "gcc-arm-none-eabi", ["-mcpu=cortex-m0plus", "-ffreestanding", "-Os"]),
        ("avr-gcc", "gcc-avr", ["-mmcu=atmega328p", "-Os"]),
    ],
)
def test_c_compiles_everywhere(strange, tmp_path, compiler, package, flags, style):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not on this machine; install the distribution's package {package}")
    for i, tree in enumerate([*strange, *(tree for name, tree in trees().items() if name != "2047 nodes")]):
        (tmp_path / f"robot{i}.c").write_text(tree.export("c", style=style, name="robot"))
        (tmp_path / f"robot{i}.h").write_text(tree.export("c-header", name="robot"))
        user = f'#include "robot{i}.h"\n#include "robot{i}.h"\n#include "robot{i}.c"\n'
        (tmp_path / f"user{i}.c").write_text(user)
    files = [f"user{j}.c" for j in range(i + 1)]
    done = subprocess.run(
        [compiler, *c.STRICT, *flags, "-c", *files],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_c_refuses_fast_math(tmp_path):
    compiler = shutil.which("cc") or pytest.skip("install the distribution's package gcc")
    (tmp_path / "policy.c").write_text(trees()["trained"].export("c"))
    command = [compiler, "-ffast-math", "-c", "policy.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode
    assert "compile without -ffast-math" in done.stderr


def test_c_says_the_size_of_its_tables(tmp_path):
    if shutil.which("size") is None:
        pytest.skip("size is not on this machine; install the distribution's package binutils")
    compiler = shutil.which("cc") or pytest.skip("install the distribution's package gcc")
    for name, tree in trees().items():
        text = tree.export("c", style="table")
        if tree.n_nodes == 1:
            assert "no tables" in text
        if tree.n_nodes < 9:
            continue  # a compiler makes such a table a part of the code
        (tmp_path / "policy.c").write_text(text)
        subprocess.run([compiler, "-O1", "-c", "policy.c"], cwd=tmp_path, check=True)
        sizes = subprocess.run(
            ["size", "-A", "policy.o"], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        constants = sum(int(n) for n in re.findall(r"^\.rodata\S*\s+(\d+)", sizes.stdout, re.MULTILINE))
        said = int(re.search(r"(\d+) bytes of tables", text)[1])  # type: ignore[index]
        # beside them there are those of the groups, and what the compiler aligns them by
        assert said <= constants <= said + 64 + 32 * len(tree.groups), name


def test_rust_is_a_crate_of_its_own_without_std(strange, tmp_path):
    compiler = shutil.which("rustc") or pytest.skip("install the distribution's package rustc")
    for tree in (*strange, trees()["grouped box"], trees()["leaf"]):
        (tmp_path / "policy.rs").write_text(tree.export("rust"))
        command = [compiler, *rust.STRICT, "--crate-type", "rlib", "--emit", "metadata", "policy.rs"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def odd_groups(tree: DecisionTree) -> tuple[np.ndarray, np.ndarray]:
    """Observations whose groups are nearly one-hot, and whether the tree accepts each."""
    rng = np.random.default_rng(25)
    x = consistent(tree, check_observations(tree, 4000))
    grouped = [feature for group in tree.groups for feature in group.features]
    odd = np.array([0, -0.0, 1, 1 + 2**-23, 1e-39, -1e-39, 1.2e-38, -1, 2, np.nan, np.inf], np.float32)
    changed = np.where(rng.random(x.shape) < 0.1, rng.choice(odd, x.shape), x)
    x[:, grouped] = changed[:, grouped]

    def accepted(row: np.ndarray) -> bool:
        try:
            tree.predict(row)
        except ValueError:
            return False
        return True

    return x, np.array([accepted(row) for row in x])


def test_c_and_rust_say_what_the_tree_accepts(tmp_path):
    tree = trees()["grouped box"]
    x, accepted = odd_groups(tree)
    assert 0.1 < accepted.mean() < 0.9
    n = tree.n_features
    for compiler, file, source in (
        ([shutil.which("cc"), *c.STRICT], "main.c", _C_VALID.format(n=n)),
        ([shutil.which("rustc"), *rust.STRICT, "-A", "dead_code", "-A", "unused_attributes"], "main.rs",
         _RUST_VALID.format(n=n)),
    ):  # fmt: skip
        if compiler[0] is None:
            pytest.skip("install the distribution's packages gcc and rustc")
        (tmp_path / "policy.c").write_text(tree.export("c"))
        (tmp_path / "policy.rs").write_text(tree.export("rust"))
        (tmp_path / file).write_text(source)
        subprocess.run([*compiler, file, "-o", "main"], cwd=tmp_path, check=True)
        done = subprocess.run(["./main"], cwd=tmp_path, input=x.tobytes(), capture_output=True, check=True)
        assert (np.frombuffer(done.stdout, np.uint8) == accepted).all()


_C_VALID = """
#include <stdio.h>
#include "policy.c"
int main(void) {{
    float x[{n}];
    while (fread(x, sizeof x, 1, stdin) == 1)
        putchar(policy_valid(x));
    return 0;
}}
"""
_RUST_VALID = """
mod policy;
use std::io::{{Read, Write}};
fn main() {{
    let mut bytes = Vec::new();
    std::io::stdin().read_to_end(&mut bytes).unwrap();
    let x: Vec<f32> = bytes.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let said: Vec<u8> = x
        .chunks({n})
        .map(|row| policy::is_valid(row.try_into().unwrap()) as u8)
        .collect();
    std::io::stdout().write_all(&said).unwrap();
}}
"""


def test_javascript_refuses_what_the_tree_refuses(tmp_path):
    node = shutil.which("node") or pytest.skip("install the distribution's package nodejs")
    tree = trees()["grouped discrete"]
    x, accepted = odd_groups(tree)
    (tmp_path / "policy.mjs").write_text(tree.export("javascript"))
    (tmp_path / "main.mjs").write_text(f"""
        import {{ readFileSync }} from "node:fs";
        import {{ act, FEATURES }} from "./policy.mjs";
        const x = new Float32Array(new Uint8Array(readFileSync(0)).buffer);
        const refused = (row) => {{
          try {{ act(row); return 0; }} catch (error) {{
            if (error instanceof RangeError) return 1;
            throw error;
          }}
        }};
        let said = "";
        for (let i = 0; i < x.length; i += {tree.n_features}) said += refused(x.subarray(i, i + {tree.n_features}));
        console.log(said + refused([1, 2]) + refused([]) + FEATURES.length);
    """)
    done = subprocess.run(
        [node, "main.mjs"], cwd=tmp_path, input=x.tobytes(), capture_output=True, check=True
    )
    said = done.stdout.decode().strip()
    assert said == "".join("0" if a else "1" for a in accepted) + f"11{tree.n_features}"


def test_javascript_rounds_as_the_tree_does(tmp_path):
    node = shutil.which("node") or pytest.skip("install the distribution's package nodejs")
    tree = trees()["255 nodes"]
    at = np.array([double_threshold(t) for t in tree.threshold[~tree.is_leaf]])
    x = np.random.default_rng(26).choice(
        np.concatenate([at, np.nextafter(at, np.inf)]), (2000, tree.n_features)
    )
    for style in ("ifs", "table"):
        (tmp_path / "policy.mjs").write_text(tree.export("javascript", style=style))
        script = f'import {{ act }} from "./policy.mjs"; console.log(JSON.stringify({x.tolist()}.map(act)));'
        (tmp_path / "main.mjs").write_text(script)
        done = subprocess.run([node, "main.mjs"], cwd=tmp_path, capture_output=True, check=True)
        assert done.stdout.decode().strip() == str(tree.predict(x).tolist()).replace(" ", "")
