"""The thesis' simulations again, beside its published figures."""
