"""What the processes share: context, the configured stages, and an axis that is estimated."""
