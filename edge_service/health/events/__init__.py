"""Events: numbered, kept on disk, and passed on to live readers."""
