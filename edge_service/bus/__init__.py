"""The only home of Zenoh."""
