"""A watched folder: every trace that a controller leaves there, once."""
