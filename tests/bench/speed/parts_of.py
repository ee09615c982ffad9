"""Names of the parts of the speed table, apart from what measures them: help must be quick.

`soak` takes an hour and is measured only where it is asked for.
"""

_GROWN, _LONG = ("growth", "jobs"), ("diagnosis", "soak")
SPEED_PARTS = ("paced", *_GROWN, "saturated", "estimator", "requests", "start", "delay", *_LONG)
