"""Parts of the node that reports to a plant."""
