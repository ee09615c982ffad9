"""Parts of the estimator's bench, and from where on their axes are counted."""

TABLE = ("own", "foreign", "thesis", "spoiled")
"""Parts whose rows make the table with aims."""
PARTS = (*TABLE, "life", "rates", "healthy", "losses", "notch", "dates", "second-plant")
FIRST_SEED = 3
