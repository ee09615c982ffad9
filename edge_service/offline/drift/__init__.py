"""Recordings of one axis on several days, compared move by move."""
