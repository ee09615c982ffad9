"""Numerical studies: the seed's simulations again, and how fast the filters are."""
