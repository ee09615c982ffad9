"""Preload from drag and stretch: one extended Kalman filter per hypothesis of what has happened.

`state` holds the estimated quantities, `physics` the measurement model of a phase of motion, `step`
the correction of every hypothesis, `hypotheses` their spawning and pruning, `posterior` their
combination into one answer.
"""
