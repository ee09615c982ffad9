"""Preload estimators: pure, fed by values that carry their own time.

`registry` names them, `interface` says what each offers; one suite of tests holds each to it.
"""
