"""Messages on disk until somebody has taken them."""
