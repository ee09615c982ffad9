"""Hidden effects: what the diagnosis says of them, held against the truth."""
