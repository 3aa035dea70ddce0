"""What tests of programs share."""

from __future__ import annotations

import pytest

from sympol import DecisionTree

from .running import strange_trees


@pytest.fixture
def strange() -> list[DecisionTree]:
    """Trees whose every name is a stranger's."""
    return strange_trees()
