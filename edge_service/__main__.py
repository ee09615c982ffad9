"""`python -m edge_service`."""

import sys

from .cli import main

sys.exit(main())
