"""One SQLite file for all that outlives the process: events, states, history, outbox."""
