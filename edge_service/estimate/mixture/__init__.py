"""Preload from drag and stretch: one extended Kalman filter per thing that may have happened.

`state` says what is followed, `physics` what a phase of motion should measure, `step` how a phase
corrects every hypothesis, `hypotheses` which of them live, `posterior` what they say together.
"""
