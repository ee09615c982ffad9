"""Names of the parts of the speed table, apart from what measures them: help must be quick."""

SPEED_PARTS = (
    "paced",
    "growth",
    "saturated",
    "estimator",
    "plant",
    "recorder",
    "history",
    "requests",
    "start",
    "delay",
    "page",
    "diagnosis",
)
