"""Bytes on the wire, both ways: JSON messages and binary edge blocks."""
