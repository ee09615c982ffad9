"""Fleet node: one of several processes that read a plant between them."""
