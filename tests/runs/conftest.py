"""A run that the tests of this folder read, and one that they may damage."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from ..tiny import TRAIN, status_of


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A finished run, which nobody changes."""
    run = tmp_path_factory.mktemp("finished") / "run"
    assert status_of("train", *TRAIN, "--run-dir", run) == 0
    return run


@pytest.fixture
def run(finished, tmp_path) -> Path:
    """A copy to damage."""
    shutil.copytree(finished, tmp_path / "run")
    return tmp_path / "run"
