"""Extended Kalman filter of one hypothesis: drift, innovation, process force, correction."""
