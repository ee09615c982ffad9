"""Diagnosis of the gap between model and machine: where it lives, why, and how far it shrinks."""
