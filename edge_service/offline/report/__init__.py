"""Pages and pictures of results: diagnosis, fingerprint, motions."""
