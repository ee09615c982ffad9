"""E-mails about events: what they say, and how they are sent."""
