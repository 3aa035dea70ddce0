"""Trees as strict JSON, described for other programs in docs/tree-json.md.

```
{"format": "sympol.tree", "version": 1,
 "features": [{"name": "pole angle", "low": -0.418, "high": 0.418}, …],      bounds: a number, "-inf" or "inf"
 "actions": {"type": "discrete", "n": 2, "start": 0, "names": ["left", "right"]},
 "nodes": [{"feature": 0, "threshold": 0.01, "left": 1, "right": 2},         preorder, the root first
           {"value": [1.5, -1.5], "visits": 62}, …],                         visits: on all leaves or on none
 "meta": {…}}
```

Numbers are float32 in the fewest digits that give them back. The file may come from a stranger: reading runs no
code, allocates no more than in proportion to the text, and refuses with a ValueError whatever is not as above.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from .actions import ActionSpec, BoxActions, DiscreteActions, MultiDiscreteActions
from .floats import shortest
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD
from .tree import DecisionTree

FORMAT = "sympol.tree"
VERSION = 1
