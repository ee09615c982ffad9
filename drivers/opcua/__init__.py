"""OPC UA: subscriptions to a machine's variables; and a stub server."""
