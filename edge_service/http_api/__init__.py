"""HTTP interface: answers, live stream, metrics and dashboard, read from the service state."""
