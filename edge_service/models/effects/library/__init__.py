"""One file per effect; each holds `EFFECT`, and being here is all that it takes to be found."""
