"""Estimator of the thesis: an interacting bank of filters (IMM), one per preload level.

The thesis, whose equation numbers stand in the docstrings, is: Brett Steven Denis Sicard, Digital
twin machine tool feed drive test bench for research on condition monitoring and modeling.
"""
