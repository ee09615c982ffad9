"""Bounds of a physical constant: the one line that refuses it otherwise."""

import math


def require_positive(**constants: float) -> None:
    """Refuse a constant that is not finite and greater than 0, by its name.

    Raises:
        ValueError: one line that names the first such constant.

    >>> require_positive(lead_m=0.02)
    >>> require_positive(lead_m=0.0)
    Traceback (most recent call last):
    ValueError: lead_m must be finite and greater than 0, got 0
    """
    for name, value in constants.items():
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} must be finite and greater than 0, got {value:g}")


def require_not_negative(**constants: float) -> None:
    """Refuse a constant that is not finite or less than 0, by its name.

    Raises:
        ValueError: one line that names the first such constant.

    >>> require_not_negative(viscous_n_s_per_m=0.0)
    >>> require_not_negative(viscous_n_s_per_m=-1.0)
    Traceback (most recent call last):
    ValueError: viscous_n_s_per_m must be finite and not negative, got -1
    """
    for name, value in constants.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} must be finite and not negative, got {value:g}")
