"""First configuration of a machine: its source found, its files written and checked."""
