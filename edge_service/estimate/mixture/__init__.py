"""Preload from drag and stretch: one extended Kalman filter per hypothesis of what has happened.

`state` holds the estimated quantities, `physics` the measurement model of a phase, `step` the
correction, `hypotheses` spawning and pruning, `posterior` the one answer.
"""
