"""A real browser, and a page to open in it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sympol.algorithms.config import Config
from sympol.envs.registry import resolve
from sympol.report import report
from sympol.runs.run import Run
from sympol.trees import DecisionTree

from .looking import Tab


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="needs the package playwright")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("needs the package chromium")
    with playwright.sync_playwright() as engine:
        one = engine.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield one
        one.close()


@pytest.fixture
def tab(browser) -> Iterator[Tab]:
    context = browser.new_context(viewport={"width": 1400, "height": 1000}, color_scheme="light")
    found = Tab(context.new_page())
    found.page.set_default_timeout(10_000)
    found.page.on("console", lambda message: found.complaints.append(message.text))
    found.page.on("pageerror", lambda error: found.complaints.append(str(error)))
    found.page.on("dialog", lambda dialog: (found.complaints.append(dialog.message), dialog.dismiss()))
    found.page.on("request", lambda request: found.asked.append(request.url))
    yield found
    context.close()
    assert found.complaints == []
    assert [url for url in found.asked if not url.startswith(("file:", "data:"))] == []
    assert sum(url.startswith("file:") for url in found.asked) <= 1


@pytest.fixture(scope="session")
def balance() -> DecisionTree:
    """A policy for CartPole that balances."""
    spec = resolve("CartPole-v1")
    return DecisionTree.from_complete(
        np.array([3, 2, 2]),
        np.array([-0.05, 0.03, -0.03]),
        np.array([[2.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 3.0]]),
        actions=spec.actions,
        feature_names=spec.features.names,
        feature_low=spec.features.low,
        feature_high=spec.features.high,
    )


@pytest.fixture(scope="session")
def run(tmp_path_factory, balance) -> Run:
    run = Run.create(tmp_path_factory.mktemp("runs") / "balance", resolve("CartPole-v1"), Config(), seed=0)
    run.save_tree(balance)
    (run.path / "safety.toml").write_text(
        '[[property]]\nname = "left is left"\n'
        'rule = "when pole angle (rad) < -0.1 and pole angular velocity (rad/s) < -1 then action is push left"\n'
        '[[property]]\nname = "</script> always right"\nrule = "action is always push right"\n'
    )
    return run


@pytest.fixture(scope="session")
def cartpole_page(run, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("pages") / "report.html"
    path.write_text(report(run, episodes=5), encoding="utf-8")
    return path
