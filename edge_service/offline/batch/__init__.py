"""Many recordings through one command, here or on the workers of a Dask cluster."""
