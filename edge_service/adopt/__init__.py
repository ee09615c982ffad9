"""Adoption of a machine from its recordings: which column is which, in which unit and sign."""
