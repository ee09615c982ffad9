"""The thesis' estimator: an interacting bank of filters, one per preload level (IMM)."""
