"""One headline for each axis, and advice on what to do."""
