"""A value with its bounds as they are printed: never less, and never more sure than they are."""

import math

_MOST_MORE = 3
"""Decimals that are added at most."""


def printed(value: float, low: float, high: float, decimals: int = 0) -> tuple[str, str, str]:
    """Value, low and high as decimals: bounds are rounded outwards, the value lies off both.

    Where the usual decimals would put the value on a bound, some are added; a value that truly is
    its bound is printed so.

    >>> printed(98.0, 90.4, 104.6)
    ('98', '90', '105')
    >>> printed(103.6, 97.2, 103.9)
    ('103.6', '97.2', '103.9')
    """
    for more in range(decimals, decimals + _MOST_MORE + 1):
        middle, least, most = _scaled(value, low, high, 10**more)
        if least < middle < most:
            decimals = more
            break
    middle, least, most = _scaled(value, low, high, 10**decimals)
    return _written(middle, decimals), _written(least, decimals), _written(most, decimals)


def _written(units: int, decimals: int) -> str:
    return f"{units / 10**decimals:.{decimals}f}"


def _scaled(value: float, low: float, high: float, scale: int) -> tuple[int, int, int]:
    """Whole numbers of the last decimal; binary fractions are no reason to round on."""
    least = math.floor(round(low * scale, 6))
    most = math.ceil(round(high * scale, 6))
    return min(max(round(value * scale), least), most), least, most
