"""Every exported program is compiled and run here, and acts as its tree does on a million observations."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group, MultiDiscreteActions
from sympol.trees.export import FORMATS, common, trial
from sympol.trees.floats import double_threshold, flushed

from .samples import (
    ACTIONS,
    HOSTILE_NAMES,
    chain,
    consistent,
    plain_leaf,
    random_grouped_tree,
    random_tree,
    telling_observations,
)

PROGRAMS: list[tuple[str, dict[str, str]]] = [
    ("python", {}),
    ("c", {"style": "ifs"}),
    ("c", {"style": "table"}),
    ("rust", {}),
    ("javascript", {"style": "ifs"}),
    ("javascript", {"style": "table"}),
    ("sql", {}),
    ("onnx", {}),
    ("treelite", {}),
]
IDS = ["-".join((to, *options.values())) for to, options in PROGRAMS]
PER_TREE = 84_000
TRAINED = Path(__file__).parents[1] / "golden" / "trees" / "trained_cartpole.json"
STRANGE = [
    *HOSTILE_NAMES,
    "*/ int x = ;", "/* // */", "?>", "ends in \\", "\\\n#error", "??/", "what??!", "</script><!--", "<script>",
    "'; DROP TABLE observations; --", '"; DROP TABLE observations; --', "`${process.exit(1)}`", "]]>", "-->",
    "%s%n{0}{tree}", "#include <nothing>", "\\u000a", "x0", "if", "act", "o", "action", "é" * 40,
]  # fmt: skip


@cache
def trees() -> dict[str, DecisionTree]:
    """One tree of each kind that a program could get wrong: twelve, so that they see a million observations."""
    rng = np.random.default_rng(20)
    discrete = ACTIONS["discrete"]
    far = DiscreteActions(3, start=2**23)  # as far as Treelite counts
    return {
        "trained": DecisionTree.from_json(TRAINED.read_text()),
        "leaf": random_tree(rng, discrete, depth=0),
        "one comparison": random_tree(rng, far, depth=1),
        **{kind: random_tree(rng, actions, depth=5) for kind, actions in ACTIONS.items()},
        **{f"grouped {kind}": random_grouped_tree(rng, ACTIONS[kind], 5, (4, 1, 3), 2) for kind in ("discrete", "box")},
        "chain to the left": chain(200, to_left=True, actions=discrete),
        "chain to the right": chain(200, to_left=False, actions=discrete),
        "255 nodes": random_tree(rng, ACTIONS["multi_discrete"], depth=7, n_features=20),
        "2047 nodes": random_tree(rng, discrete, depth=10, n_features=5),
    }  # fmt: skip


@cache
def seen(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Observations that the tree accepts, and what it does."""
    tree, rng = trees()[name], np.random.default_rng(21)
    x = telling_observations(tree, rng, PER_TREE)
    for group in tree.groups:
        x[:, group.features] = np.eye(len(group.features))[rng.integers(len(group.features), size=len(x))]
    return x, tree.predict(x).reshape(len(x), -1)


def ran(tree: DecisionTree, to: str, x: np.ndarray, **options: Any) -> np.ndarray:
    """Run a program, or skip where its compiler is not there."""
    try:
        return trial.run(tree, to, x, **options).actions
    except FileNotFoundError as error:
        pytest.skip(str(error))


def same(acted: np.ndarray, expected: np.ndarray, to: str) -> bool:
    """Bit for bit; to SQL and Treelite, which add or have no -0.0, zero has no sign."""
    if to in ("sql", "treelite"):
        return acted.shape == expected.shape and (acted == expected).all()
    return acted.shape == expected.shape and acted.astype(expected.dtype).tobytes() == expected.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize(("to", "options"), PROGRAMS, ids=IDS)
def test_it_acts_as_the_tree_does_on_a_million_observations(to, options):
    n = 0
    for name, tree in trees().items():
        x, expected = seen(name)
        assert same(ran(tree, to, x, **options), expected, to), name
        n += len(x)
    assert n > 1_000_000


def test_what_the_programs_are_compared_with_is_the_plain_loop():
    for name, tree in trees().items():
        x, expected = seen(name)
        for row, action in zip(x[:50], expected[:50], strict=True):
            leaf = plain_leaf(tree, row)
            assert (np.ravel(tree.actions.decide(tree.value[[leaf]])) == action).all()


def test_observations_tried_on_the_command_s_request_tell_the_same_things():
    for tree in trees().values():
        x = trial.trial_observations(tree, 30_000)
        tree.predict(x)  # none is refused
        free = [i for i in range(tree.n_features) if i not in tree.group_of]
        numbers = x[:, free]
        assert np.isnan(numbers).any()
        assert np.isposinf(numbers).any()
        assert np.isneginf(numbers).any()
        assert ((numbers != 0) & (flushed(numbers) == 0)).any()
        assert (np.signbit(numbers) & (numbers == 0)).any()
        asked = np.flatnonzero(~tree.is_leaf)[:50]
        for feature, threshold in zip(tree.feature[asked], tree.threshold[asked], strict=True):
            if feature in free:
                above = np.nextafter(threshold, np.float32(np.inf))
                assert (x[:, feature] == threshold).any()
                assert (x[:, feature] == above).any()


@pytest.mark.parametrize(
    "threshold", [0.0, -0.0, 1.0, 0.1, -0.1, 2.0**-126, -(2.0**-126), 3.4028235e38, -3.4028235e38]
)
def test_a_threshold_takes_rounding_on_itself(threshold):
    check_double_threshold(float(np.float32(threshold)))


def test_random_thresholds_take_rounding_on_themselves():
    bits = np.random.default_rng(22).integers(0, 2**32, 3000, dtype=np.uint32)
    for threshold in flushed(bits.view(np.float32)[np.isfinite(bits.view(np.float32))]):
        check_double_threshold(float(threshold))


def check_double_threshold(threshold: float) -> None:
    at = double_threshold(threshold)
    above = math.nextafter(at, math.inf)
    assert flushed(at) <= np.float32(threshold) < flushed(above)
    # NumPy compares its float32 numbers with the threshold rounded to float32
    number = np.float32(threshold)
    assert number <= at
    with np.errstate(over="ignore"):
        first = np.float32(2.0**-126) if threshold == 0 else np.nextafter(number, np.float32(np.inf))
    assert not first <= at


def act_of(tree: DecisionTree) -> Callable[[Any], Any]:
    namespace: dict[str, Any] = {"__name__": "policy"}
    exec(tree.to_python(), namespace)
    return namespace["act"]


def test_python_takes_numbers_of_every_kind():
    rng = np.random.default_rng(23)
    tree = trees()["2047 nodes"]
    act = act_of(tree)
    doubles = np.array([double_threshold(t) for t in tree.threshold[~tree.is_leaf]])
    doubles = np.concatenate(
        [doubles, np.nextafter(doubles, np.inf), [1e300, -1e300, 5e-324, np.nan, np.inf, 0.0]]
    )
    for row in rng.choice(doubles, (4000, tree.n_features)):
        expected = tree.predict(row)
        assert act(row.tolist()) == act(tuple(row.tolist())) == act(row) == expected
    for row in rng.integers(-3, 3, (200, tree.n_features)):
        assert act(row.tolist()) == act(row) == act(row.astype(np.int8)) == tree.predict(row)
    for row in rng.choice(seen("2047 nodes")[0].ravel(), (500, tree.n_features)):
        assert act(row) == tree.predict(row)
    assert act([True] * 5) == tree.predict([1] * 5)


def test_nesting_grows_with_the_logarithm_of_the_leaves():
    for tree in trees().values():
        deepest = max(step.level for step in common.steps(tree))
        assert deepest <= common.MAX_HEIGHT + math.log2(tree.n_leaves)
        kinds = [step.kind for step in common.steps(tree)]
        assert kinds.count("if") == kinds.count("end") == tree.n_leaves - 1
        assert kinds.count("answer") == tree.n_leaves


@pytest.fixture(scope="module")
def strange() -> list[DecisionTree]:
    """Trees whose every name is a stranger's, one for each kind of actions and one with a group."""
    n = len(STRANGE)
    rng = np.random.default_rng(24)
    made = [
        DiscreteActions(n, tuple(STRANGE)),
        MultiDiscreteActions((2,) * n, tuple(STRANGE), tuple((name, "plain") for name in STRANGE)),
        BoxActions((-1,) * n, (1,) * n, (n,), tuple(STRANGE)),
    ]
    # a comparison for each name
    depth = math.ceil(math.log2(n + 1))
    feature = np.resize(np.arange(n), 2**depth - 1)
    threshold, values = (
        rng.normal(size=len(feature)),
        [rng.normal(size=(2**depth, a.n_outputs)) for a in made],
    )
    return [
        DecisionTree.from_complete(feature, threshold, value, actions=actions, feature_names=STRANGE)
        for actions, value in zip(made, values, strict=True)
    ] + [
        DecisionTree.from_complete(
            feature,
            np.where(feature < n // 2, threshold, 0.5),
            values[0],
            actions=made[0],
            feature_names=STRANGE,
            groups=[
                Group(STRANGE[i], tuple(range(i, n, 2)), tuple(STRANGE[i::2]))
                for i in (n - n % 2 - 2, n - n % 2 - 1)
            ],
        )
    ]


@pytest.mark.parametrize(("to", "options"), PROGRAMS, ids=IDS)
def test_it_runs_whatever_things_are_called(strange, to, options):
    for tree in strange:
        x = trial.trial_observations(tree, 2000)
        assert same(ran(tree, to, x, **options), tree.predict(x).reshape(len(x), -1), to)


def plainly_named(tree: DecisionTree) -> DecisionTree:
    actions = replace(tree.actions, names=())
    if isinstance(actions, MultiDiscreteActions):
        actions = replace(actions, options=())
    groups = tuple(
        replace(group, name=f"g{i}", categories=tuple(f"c{j}" for j in range(len(group.features))))
        for i, group in enumerate(tree.groups)
    )
    names = tuple(f"f{i}" for i in range(tree.n_features))
    return replace(tree, actions=actions, groups=groups, feature_names=names)


def without_comments(text: str, to: str) -> str:
    """What a compiler makes of it: comments and strings are nothing."""
    if to.startswith("c"):
        return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    mark = "--" if to == "sql" else "//"
    strings = r'"(?:[^"]|"")*"' if to == "sql" else r'"(?:[^"\\\n]|\\.)*"'
    return re.sub(rf"({strings})|{mark}[^\n]*", "", text)


@pytest.mark.parametrize("to", ["c", "c-header", "rust", "javascript", "sql"])
def test_a_name_of_a_stranger_is_nothing_but_comment_and_string(strange, to):
    for tree in strange:
        text = tree.export(to)
        assert text.isprintable() or set(filter(lambda c: not c.isprintable(), text)) == {"\n"}
        if to != "sql":  # a column may be called in any language
            assert text.isascii()
        plain = plainly_named(tree).export(to)
        assert without_comments(text, to) == without_comments(plain, to)
        # as C99 reads it, which knows trigraphs, and as a page does in which the program stands
        assert "??" not in text or not to.startswith("c")
        if to == "javascript":
            assert not re.search(r"<[/!a-zA-Z]", text)


def test_comments_end_where_they_are_to_end():
    for name in STRANGE:
        words = common.comment(name)
        assert words.isascii()
        assert words.isprintable()
        assert not re.search(r"\*/|/\*|\?\?|\?>|<[/!a-zA-Z]|-->|]]>|\\$", words)
    assert common.comment("speed (km/h) ≤ 3 * 2") == "speed (km/h) <= 3 * 2"


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
        [compiler, *trial.STRICT_C, *flags, "-c", *files],
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
        command = [compiler, *trial.STRICT_RUST, "--crate-type", "rlib", "--emit", "metadata", "policy.rs"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def odd_groups(tree: DecisionTree) -> tuple[np.ndarray, np.ndarray]:
    """Observations whose groups are nearly one-hot, and whether the tree accepts each."""
    rng = np.random.default_rng(25)
    x = consistent(tree, trial.trial_observations(tree, 4000))
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
        ([shutil.which("cc"), *trial.STRICT_C], "main.c", _C_VALID.format(n=n)),
        ([shutil.which("rustc"), *trial.STRICT_RUST, "-A", "dead_code", "-A", "unused_attributes"], "main.rs",
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


def test_the_program_stands_in_a_page_whatever_things_are_called(strange):
    sync_api = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is not on this machine; install the distribution's package chromium")
    with sync_api.sync_playwright() as playwright:
        options = ["--no-sandbox"] if os.getuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=chromium, args=options)
        page, said = browser.new_page(), []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("dialog", lambda dialog: said.append("a name became a program"))
        for tree in strange:
            x = trial.trial_observations(tree, 200)
            x = x[np.isfinite(x).all(axis=1)]
            script = f"{tree.export('javascript')}\nwindow.acted = {x.tolist()}.map(act).flat();"
            page.set_content(f"<script type=module>{script}</script><p>the end</p>")
            page.wait_for_function("window.acted !== undefined")
            assert page.evaluate("window.acted") == tree.predict(x).ravel().tolist()
            assert page.evaluate("document.body.innerText") == "the end"
            page.evaluate("delete window.acted")
        browser.close()
    assert said == []


def test_onnx_is_a_model_by_its_own_checker(strange):
    onnx = pytest.importorskip("onnx")
    for tree in strange:
        model = onnx.load_from_string(tree.export("onnx", name="robot"))
        onnx.checker.check_model(model, full_check=True)
        assert model.graph.name == "robot"
        names = {entry.key: json.loads(entry.value) for entry in model.metadata_props}
        assert names == {"features": list(tree.feature_names), "actions": list(tree.actions.names)}


def test_a_program_that_does_not_end_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(trial, "TIMEOUT", 0.2)
    with pytest.raises(RuntimeError, match=r"python.* did not end in 0\.2 seconds"):
        trial.call([sys.executable, "-c", "while True: pass"], tmp_path)


def with_start(start: int) -> DecisionTree:
    return DecisionTree.from_complete(
        np.array([0]), np.zeros(1), np.eye(2), actions=DiscreteActions(2, start=start), feature_names=["x"]
    )


@pytest.mark.parametrize("start", [-(2**31), 2**31 - 2, 2**31 - 1, 2**40, -(2**53), 2**53 - 1])
@pytest.mark.parametrize(("to", "options"), PROGRAMS[:-1], ids=IDS[:-1])
def test_large_actions_are_whole(start, to, options):
    if to == "rust" and start not in (2**31 - 2, 2**40):
        return
    x = np.array([[0], [1], [np.nan]], np.float32)
    assert ran(with_start(start), to, x, **options).ravel().tolist() == [start, start + 1, start + 1]


@pytest.mark.parametrize("to", [to for to in trial.RUNS if to != "treelite"])
def test_actions_too_large_are_refused(to):
    with pytest.raises(ValueError, match=r"2\^53"):
        with_start(2**53).export(to)


def test_treelite_refuses_what_float32_does_not_count():
    with pytest.raises(ValueError, match=r"2\^24"):
        with_start(2**24).export("treelite")


def test_infinite_actions_are_refused():
    tree = DecisionTree.from_complete(
        np.zeros(0, int),
        np.zeros(0),
        np.zeros((1, 1)),
        actions=BoxActions(np.inf, np.inf, (1,)),
        feature_names=["x"],
    )
    with pytest.raises(ValueError, match="must be finite"):
        tree.export("c")


@pytest.mark.parametrize("name", ["", "1st", "my robot", "robot;", "é", "a" * 64, "_x"])
def test_names_that_are_none_are_refused(name):
    for to in ("c", "c-header", "onnx"):
        with pytest.raises(ValueError, match="try 'policy'"):
            trees()["trained"].export(to, name=name)


@pytest.mark.parametrize("to", ["c", "javascript", "sql"])
def test_styles_that_are_none_are_refused(to):
    with pytest.raises(ValueError, match=r"style must be \w+ or \w+, got 'rococo'"):
        trees()["trained"].export(to, style="rococo")


@pytest.mark.parametrize(("to", "module"), [("onnx", "onnx"), ("treelite", "treelite.model_builder")])
def test_without_its_library_the_error_names_the_remedy(to, module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf"pip install 'sympol\[{to}\]'"):
        trees()["trained"].export(to)


def test_every_format_writes_what_it_says():
    tree = trees()["trained"]
    for to, form in FORMATS.items():
        assert isinstance(tree.export(to), bytes if form.binary else str)
        assert form.suffix.startswith(".")


@pytest.mark.parametrize("to", list(trial.RUNS))
def test_a_tree_without_features_is_not_tried(to):
    tree = DecisionTree.from_complete(np.zeros(0, int), np.zeros(0), np.eye(1, 2), actions=DiscreteActions(2))
    assert tree.export(to)
    with pytest.raises(ValueError, match="without features"):
        trial.run(tree, to, np.zeros((3, 0), np.float32))


def test_a_program_that_fails_says_so(monkeypatch):
    tree, x = trees()["trained"], np.zeros((1, 4), np.float32)
    monkeypatch.setattr(trial.c, "to_c", lambda tree: "int policy_act(const float *x) { return y; }\n")
    with pytest.raises(RuntimeError, match=r"cc failed with status 1: (?s:.*)undeclared"):
        ran(tree, "c", x)
    monkeypatch.setattr(trial.shutil, "which", lambda name: None)
    for to, package in (("c", "gcc"), ("rust", "rustc"), ("javascript", "nodejs")):
        with pytest.raises(FileNotFoundError, match=f"install the distribution's package {package}$"):
            trial.run(tree, to, x)
