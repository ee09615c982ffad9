"""Routes of the HTTP interface, by topic."""
