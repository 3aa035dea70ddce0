"""The classes of inputs of `studies.benchmarks.fuzz`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .fuzz_ask import Fuzzer
from .fuzz_flags import Flags
from .fuzz_observations import Observations
from .fuzz_runs import Runs
from .fuzz_trees import Json, Properties, Text

CLASSES: dict[str, Callable[[Path], Fuzzer]] = {
    "json": Json,
    "text": Text,
    "properties": Properties,
    "runs": Runs,
    "flags": Flags,
    "observations": Observations,
}
