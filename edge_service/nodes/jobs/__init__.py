"""Recordings and the jobs made of them, each in a process of its own."""
