"""The physics: pure, no clock, no I/O, no event loop."""
