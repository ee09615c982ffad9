"""Identity and rights of whoever asks."""
