"""``python -m sympol`` is the command `sympol`."""

import sys

from .cli.app import main

sys.exit(main())
