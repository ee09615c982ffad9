"""Commands on recordings and machine files: one module per command."""
