"""`python -m edge_service`."""

import sys

from .cli.entry import main

sys.exit(main())
