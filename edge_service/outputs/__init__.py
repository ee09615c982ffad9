"""What leaves the bus for systems that people already have."""
