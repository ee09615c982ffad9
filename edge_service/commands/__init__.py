"""The commands of `edge-service`, by topic: each reads its arguments and calls a room."""
