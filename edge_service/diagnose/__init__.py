"""Diagnosis of the sim-to-real gap: where model and machine disagree, why, and how far it shrinks.

The stages, as `pipeline` runs them:

1. `session`: recordings of one axis, checked, as rows of what the model leaves of torque and
   position between the encoders; `residual`: their noise floor, and the healthy machine's own gap.
2. `candidates`: effects of the library as regressors of a design matrix.
3. `selection`: stepwise and exhaustive selection, and a posterior over sets of effects.
4. `estimation`: values of the named effects, their intervals and contributions.
5. `validation`: cross validation, misattribution, replay in the plant, and the verdict.
6. `localisation`: variables and intervals in which the gap lives.

`experiment` proposes the motion that decides what a recording leaves open.
"""
