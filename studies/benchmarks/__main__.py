"""Every benchmark, one after the other: ``make bench``. About half an hour on two quiet cores."""

from __future__ import annotations

import subprocess
import sys

for name in ("hard_tree", "training", "worlds", "returns", "minigrid", "exports", "verify", "arena"):
    subprocess.run([sys.executable, "-m", f"studies.benchmarks.{name}"], check=True)
