"""Numbers with units and intervals as people read them."""

import math

from ...diagnose.result import ParameterValue
from ...models.machine import Quantity
from ...regression.interval_estimate import IntervalEstimate

SHOWN_UNITS = {  # SI unit -> the unit that people read, and its factor
    "m": ("µm", 1e6),
    "N/m": ("N/µm", 1e-6),
    "m/N": ("µm/kN", 1e9),
    "rad": ("°", 180.0 / math.pi),
    "rad/s": ("r/min", 30.0 / math.pi),
    "kg m^2": ("kg cm²", 1e4),
    "s": ("ms", 1e3),
    "1": ("", 1.0),
    "degC": ("°C", 1.0),
}
_MOST_DECIMALS = {"m": 3}  # shown at most: nobody wants to know less than a nanometre


def estimate(figure: IntervalEstimate) -> str:
    """Value and interval with the digits that the interval allows.

    >>> estimate(IntervalEstimate(8.0e-6, 7.6e-6, 8.4e-6, "m", 9.0))
    '8.00 µm (7.60 to 8.40)'
    >>> estimate(IntervalEstimate(math.nan, 0.0, 8.4e-6, "m", 9.0))
    '0.0 to 8.4 µm'
    """
    unit, factor = SHOWN_UNITS.get(figure.unit, (figure.unit, 1.0))
    known = math.isfinite(figure.value)
    if not known and not figure.determined:
        return "undetermined"
    half = 0.5 * (figure.high - figure.low) * factor
    value = figure.value * factor if known else figure.high * factor
    spread = half if math.isfinite(half) and half > 0.0 else abs(value) or 1.0
    decimals = 1 - math.floor(math.log10(spread))
    decimals = min(decimals, _MOST_DECIMALS.get(figure.unit, decimals))
    digits = max(decimals + 1 + math.floor(math.log10(abs(value) or spread)), 2)
    form = f"#.{digits}g" if decimals > 5 else f".{max(decimals, 0)}f"
    low, middle, high = (f"{factor * x:{form}}" for x in (figure.low, figure.value, figure.high))
    text = f"{middle} {unit} ({low} to {high})" if known else f"{low} to {high} {unit}"
    return text.replace("  ", " ").strip()


def interval(value: ParameterValue) -> str:
    """Value and interval in a handy unit."""
    unit, factor = SHOWN_UNITS.get(value.unit, (value.unit, 1.0))
    if value.unit == "m" and abs(value.value) >= 1e-3:
        unit, factor = "mm", 1e3
    elif value.unit == "s" and abs(value.value) >= 0.1:
        unit, factor = value.unit, 1.0
    low = -math.inf if value.low is None else value.low
    high = math.inf if value.high is None else value.high
    low, middle, high = (factor * each for each in (low, value.value, high))
    return f"{middle:.3g} {unit} ({low:.3g} to {high:.3g})".replace("  ", " ")


def amount(value: float, unit: str) -> str:
    """A value in a handy unit.

    >>> amount(7.22e-7, "m"), amount(3.5789e-3, "m"), amount(2.16e-8, "m/N")
    ('0.722 µm', '3580 µm', '21.6 µm/kN')
    """
    shown_unit, factor = SHOWN_UNITS.get(unit, (unit, 1.0))
    return f"{float(f'{factor * value:.3g}'):g} {shown_unit}"


def percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def words(name: str) -> str:
    """A name without its underscores."""
    return name.replace("_", " ")


def tolerated(quantity: Quantity, unit: str) -> str:
    """A value with its relative tolerance.

    >>> tolerated(Quantity(value=1.5e-3, tolerance=0.02), "kg m2")
    '0.0015 kg m2 +- 2 %'
    >>> tolerated(Quantity(value=0.0), "N m s/rad")
    'not told from none'
    """
    known = f"{quantity.value:.4g} {unit} +- {100 * quantity.tolerance:.2g} %"
    return known if quantity.tolerance < 1.0 and quantity.value else "not told from none"


def against(figure: IntervalEstimate, expected: float | None) -> str:
    """A value with its interval beside what is expected of it; empty where it is undetermined.

    >>> against(IntervalEstimate(0.02, 0.019, 0.021, "m", 9.0), 0.01)
    '0.02 m, 0.019 to 0.021; expected 0.01'
    >>> against(IntervalEstimate(0.99996, 0.99992, 1.00001, "", 9.0), 1.0)
    '1; expected 1'
    >>> against(IntervalEstimate(1.57e-4, -4.06e-4, 7.2e-4, "ms", 9.0), 0.0)
    'less than 0.001 ms apart'
    """
    if not figure.determined:
        return ""
    unit, most = f" {figure.unit}" if figure.unit else "", max(abs(figure.low), abs(figure.high))
    if expected == 0.0 and 0.0 < most < 0.01:
        return f"less than {10.0 ** math.ceil(math.log10(most)):g}{unit} apart"
    low, value, high = (f"{each:.3g}" for each in (figure.low, figure.value, figure.high))
    text = f"{value}{unit}" if low == high else f"{value}{unit}, {low} to {high}"
    return text if expected is None else f"{text}; expected {expected:.3g}"
