"""Candidate causes as regressors, and the normal equations that their fits need."""
