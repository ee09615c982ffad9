"""Gap of a model to its machine, and the diagnosis of it, from recordings."""
