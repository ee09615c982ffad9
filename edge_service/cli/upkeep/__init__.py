"""Commands that look after what a service is made of: backups, roll-outs."""
