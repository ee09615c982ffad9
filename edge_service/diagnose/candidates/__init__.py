"""Candidate causes as regressors, their design matrix, and its normal equations."""
