"""Questions that are asked of a channel, recorded or live, each once."""
