"""State on disk that outlives the process."""
