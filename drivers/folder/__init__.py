"""A watched folder of traces."""
