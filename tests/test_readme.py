"""What the README says was measured is what the records say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from studies.galleries.fronts import load_all, readme

ROOT = Path(__file__).resolve().parents[1]
SLUGS = {
    "SYMPOL": "tree",
    "D-SDT": "d-sdt",
    "SA-DT (d=5)": "sa-dt-5",
    "SA-DT (d=8)": "sa-dt-8",
    "VIPER (d=5)": "viper-5",
    "VIPER (d=8)": "viper-8",
    "MLP": "mlp",
    "SDT": "sdt",
}


def rows() -> list[list[str]]:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    table = text.split("<!-- rivals", 1)[1].split("<!-- end -->", 1)[0].split("-->", 1)[1]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.strip().splitlines()]


HEAD, _, *BODY = rows()


def test_the_speed_of_programs_is_as_measured():
    measured = json.loads((ROOT / "studies" / "results" / "exports.json").read_text(encoding="utf-8"))
    ns = {name: row["median_ns"] for name, row in measured["decision"].items()}
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    said = text.split("<!-- exports: tests/test_readme.py -->")[1].split("<!-- end exports -->")[0]
    assert " ".join(said.split()) == (
        f"{ns['C, ifs']:.0f} ns in C, {ns['Python file, lists']:.0f} ns in Python; "
        f"{ns['onnxruntime, one row']:,.0f} ns by onnxruntime, "
        f"{ns['scikit-learn predict, one row'] / 1000:.0f} µs by scikit-learn and "
        f"{ns['stable-baselines3 predict, one row'] / 1000:.0f} µs by stable-baselines3's `predict`"
    )
    assert f"it is {min(measured['code_bytes']['Cortex-M0+'].values())} bytes" in text


def test_the_fronts_are_those_of_the_results():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = text.split("<!-- fronts: python -m studies.galleries.fronts --readme -->\n")[1]
    tasks = load_all(ROOT)
    assert shown.split("<!-- end fronts -->")[0] == readme(tasks)
    quoted = {"CartPole-v1": 5, "sympol/DistShift-Random-v0": 13}
    trees = {fronts[0].environment: fronts[0].best(quoted.get(fronts[0].environment)) for fronts in tasks}
    for name in quoted:
        point = trees[name]
        assert point is not None
        assert f"```\n{point.tree.to_text()}\n```" in text


@pytest.mark.parametrize("row", BODY, ids=[row[0].strip("* ") for row in BODY])
def test_the_rivals_are_as_measured(row):
    slug, nodes = SLUGS[row[0].strip("* ")], []
    for environment, cell in zip(HEAD[1:6], row[1:6], strict=True):
        (folder,) = (ROOT / "studies" / "results" / "cells").glob(f"{environment}-v*")
        file = folder / f"ppo-{slug}.json"
        if not file.exists():
            assert cell in ("not run", "–")
            continue
        record = json.loads(file.read_text(encoding="utf-8"))
        means = np.mean(record["returns"], axis=1)
        assert len(means) == 5
        assert cell.strip("*") == f"{means.mean():.0f} ± {means.std(ddof=1):.0f}".replace("-", "−")
        nodes += [np.mean(record["nodes"])] if record["nodes"] else []
    assert row[6] == (f"{np.mean(nodes):.0f}" if nodes else "")
