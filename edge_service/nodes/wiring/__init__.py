"""Parts that the processes share: context, configured stages, and an axis that is estimated."""
