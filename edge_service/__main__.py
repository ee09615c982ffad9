"""`python -m edge_service`."""

import sys

from .cli.entry import main
from .process import end_with_parent

end_with_parent()
sys.exit(main())
