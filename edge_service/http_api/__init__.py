"""The HTTP interface: answers, live stream, metrics and dashboard, all read from the service state."""
