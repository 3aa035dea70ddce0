"""The README's table of rivals is what the records say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

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


@pytest.mark.parametrize("row", BODY, ids=[row[0].strip("* ") for row in BODY])
def test_the_rivals_are_as_measured(row):
    slug, nodes = SLUGS[row[0].strip("* ")], []
    for environment, cell in zip(HEAD[1:6], row[1:6], strict=True):
        (folder,) = (ROOT / "results" / "cells").glob(f"{environment}-v*")
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
