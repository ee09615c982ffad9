"""One file per process: wiring, loop, clock and signals; nothing clever."""
