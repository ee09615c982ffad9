"""The library of effects: what can set a real feed drive apart from its baseline model."""
