"""Backups of a service: its configuration and its history in one file."""
