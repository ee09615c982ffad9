"""Answers for agents of MTConnect: an adapter of the SHDR protocol, and its description."""
