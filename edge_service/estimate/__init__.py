"""Preload estimators: pure, fed by values that carry their own time."""
