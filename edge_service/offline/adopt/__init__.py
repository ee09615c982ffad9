"""`edge-service adopt`: a machine file from recordings."""
