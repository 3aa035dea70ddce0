"""The classes of inputs of `studies.benchmarks.fuzz`."""

from __future__ import annotations

from .fuzz_ask import InputClass
from .fuzz_flags import Flags
from .fuzz_observations import Observations
from .fuzz_runs import Runs
from .fuzz_trees import Json, Properties, Text

CLASSES: dict[str, InputClass] = {
    "json": Json,
    "text": Text,
    "properties": Properties,
    "runs": Runs,
    "flags": Flags,
    "observations": Observations,
}
