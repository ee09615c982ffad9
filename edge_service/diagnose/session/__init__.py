"""Recordings of one axis as rows of two channels, with noise floor and tolerance."""
