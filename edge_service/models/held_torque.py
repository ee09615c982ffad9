"""Torque between two samples: held, or a point of what goes on between them."""

LONGEST_HOLD_S = 0.0045
"""A drive holds its torque command from one cycle of its position control to the next; such cycles
last 4 ms at most. Slower samples are points of a torque that goes on between them."""
