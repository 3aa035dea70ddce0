"""Build the environments of rivals and print their interpreters.

python -m studies.benchmarks.rivals [NAME ...]
"""

from __future__ import annotations

import sys

from .environment import NAMES, interpreter

for name in sys.argv[1:] or NAMES:
    print(name, interpreter(name))
