"""A tree as a package of its own: it installs, acts as the tree does, and says so itself."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, MultiDiscreteActions
from sympol.trees.export.package import MAX_LEAVES, recorded, to_package

from .samples import ACTIONS, HOSTILE_NAMES, chain, random_grouped_tree, random_tree


def written(tree: DecisionTree, folder: Path, name: str = "some_policy") -> Path:
    for path, text in to_package(tree, name).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    return folder


def own_tests(folder: Path, *, break_it: bool = False) -> subprocess.CompletedProcess[str]:
    """Run the package's tests as a stranger would, without installing it."""
    if break_it:
        policy = next(folder.glob("src/*/policy.py"))
        lower = lambda match: f"<= {np.nextafter(np.float32(match[1]), np.float32(-np.inf))!s}:"  # noqa: E731
        policy.write_text(
            re.sub(r"<= ([-\d.e]+):", lower, policy.read_text("utf-8"), count=1), encoding="utf-8"
        )
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"],
        cwd=folder, env={**os.environ, "PYTHONPATH": "src"}, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("grouped", [False, True])
def test_its_cases_are_what_the_tree_answers(kind, grouped, tmp_path):
    rng = np.random.default_rng(6)
    for depth in (0, 1, 4, 6):
        draw = random_grouped_tree if grouped else random_tree
        tree = draw(rng, ACTIONS[kind], depth)
        folder = written(tree, tmp_path / f"{depth}")
        space = runpy.run_path(str(folder / "src/some_policy/policy.py"))
        test = (folder / "tests/test_policy.py").read_text("utf-8")
        namespace: dict = {"act": space["act"], "FEATURES": space["FEATURES"]}
        exec(test.replace("from some_policy import FEATURES, act", ""), namespace)
        namespace["test_it_answers_as_the_tree"]()
        namespace["test_an_observation_of_another_length_is_refused"]()
        for observation, action in namespace["CASES"]:
            assert np.ravel(tree.predict(observation)).tolist() == np.ravel(action).tolist()
        reachable = set(tree.apply(recorded(tree)).tolist())
        cells = {int(leaf) for leaf in np.flatnonzero(tree.is_leaf)}
        assert reachable <= cells
        assert len(reachable) > 1 or depth <= 1


def test_every_threshold_on_the_way_to_a_leaf_is_recorded_from_both_sides():
    rng = np.random.default_rng(7)
    tree = random_tree(rng, ACTIONS["discrete"], 5).prune(bounds=False, merge=False)
    x = recorded(tree)
    assert set(tree.apply(x).tolist()) == set(np.flatnonzero(tree.is_leaf).tolist())
    for node in np.flatnonzero(~tree.is_leaf):
        seen = x[:, tree.feature[node]]
        assert (seen == tree.threshold[node]).any()
        if abs(tree.threshold[node]) > 1e-30:
            assert (seen == np.nextafter(tree.threshold[node], np.float32(np.inf))).any()
    assert np.isnan(x).any()
    assert np.isinf(x).any()


def test_a_large_tree_has_a_small_test():
    tree = chain(3000, to_left=True, actions=DiscreteActions(2))
    assert len(recorded(tree)) <= 2 * MAX_LEAVES + 3


def test_its_own_test_passes_and_finds_the_least_wrong_threshold(cartpole, tmp_path):
    done = own_tests(written(cartpole, tmp_path))
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout
    assert "1 failed, 1 passed" in own_tests(tmp_path, break_it=True).stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cartpole", "pendulum", "front"])
def test_it_installs_and_acts_alone(name, request, tmp_path):
    tree: DecisionTree = request.getfixturevalue(name)
    folder, site = written(tree, tmp_path / "made", "my_policy"), tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(site), str(folder)]
    done = subprocess.run(install, capture_output=True, text=True, check=False)
    if "No matching distribution found for setuptools" in done.stderr:
        pytest.skip("no package registry, and setuptools builds the package")
    assert done.returncode == 0, done.stderr
    assert (site / "my_policy/py.typed").is_file()
    assert (site / "my_policy/policy.pyi").is_file()
    x = recorded(tree)[0].tolist()
    code = f"import my_policy\nprint(my_policy.act({x}))"
    # -S: without this environment's packages
    done = subprocess.run(
        [sys.executable, "-S", "-c", code],
        env={"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert np.ravel(eval(done.stdout)).tolist() == np.ravel(tree.predict(x)).tolist()


@pytest.mark.slow
def test_linters_and_the_type_checker_have_nothing_to_say(tmp_path):
    rng = np.random.default_rng(8)
    for i, actions in enumerate(ACTIONS.values()):
        written(random_grouped_tree(rng, actions, 4), tmp_path / f"p{i}", f"policy_{i}")
    use = "from policy_1 import act\n\ngas, steer = act([0.0])\nprint(gas + steer)\nact('x').split()\n"
    (tmp_path / "use.py").write_text(use)
    ruff = [sys.executable, "-m", "ruff", "check", "--isolated", str(tmp_path)]
    assert subprocess.run(ruff, capture_output=True, check=False).returncode == 0
    paths = [f"p{i}/src" for i in range(3)]
    (tmp_path / "pyrightconfig.json").write_text(
        f'{{"include": {paths}, "extraPaths": {paths}}}'.replace("'", '"')
    )
    pyright = [sys.executable, "-m", "pyright", "-p", str(tmp_path)]
    done = subprocess.run(pyright, capture_output=True, text=True, check=False)
    assert "0 errors, 0 warnings" in done.stdout, done.stdout
    (tmp_path / "pyrightconfig.json").write_text(
        f'{{"include": ["use.py"], "extraPaths": {paths}}}'.replace("'", '"')
    )
    done = subprocess.run(pyright, capture_output=True, text=True, check=False)
    assert '"str" is not assignable' in done.stdout or "Literal['x']" in done.stdout, done.stdout
    assert "3 errors" in done.stdout or "2 errors" in done.stdout, done.stdout


@pytest.mark.parametrize("name", [*HOSTILE_NAMES, "``` ````` ```", "*/ </script> '; DROP TABLE x"])
def test_a_name_stays_a_name(name):
    def named(name: str) -> dict[str, str]:
        tree = DecisionTree.from_complete(
            np.array([0]),
            np.array([0.0]),
            np.eye(2, 4),
            actions=MultiDiscreteActions((2, 2), (name, name), ((name, name),) * 2),
            feature_names=[name],
            meta={name: name},
        )
        return to_package(tree, "some_policy")

    files, plain = named(name), named("x")
    assert files.keys() == plain.keys()
    for path in files.keys() - {"README.md", "src/some_policy/policy.py"}:
        assert files[path] == plain[path]
    tomllib.loads(files["pyproject.toml"])
    readme = files["README.md"].encode("utf-8").decode()
    outside = re.sub(r"^(`{3,})text\n.*?^\1$", "", readme, flags=re.M | re.S)
    assert outside == re.sub(r"^(`{3,})text\n.*?^\1$", "", plain["README.md"], flags=re.M | re.S)
    assert "x" not in outside.split("## Where it is from")[1]


@pytest.mark.parametrize(
    "name", ["", "My_policy", "my-policy", "1st", "class", "../x", "json", "tests", "x y", "é"]
)
def test_a_name_that_python_does_not_import_is_refused(cartpole, name):
    with pytest.raises(ValueError, match="name"):
        to_package(cartpole, name)
