"""Interface and page of a fleet node: every axis of a plant."""
