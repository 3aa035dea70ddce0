"""``python -m sympol`` is the command `sympol`."""

import sys

from .cli import main

sys.exit(main())
