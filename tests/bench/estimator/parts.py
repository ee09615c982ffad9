"""Parts of the estimator's bench, and from where on their axes are counted."""

TABLE = ("own", "foreign", "thesis")
"""Parts whose rows make the table with aims."""
PARTS = (*TABLE, "life", "healthy", "losses", "lying", "notch", "dates")
FIRST_SEED = 3
