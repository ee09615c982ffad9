"""Engineering units of OPC UA: the numeric form of their codes in UNECE Recommendation 20."""

_CODES = {
    "m": "MTR",
    "mm": "MMT",
    "um": "4H",
    "m/s": "MTS",
    "mm/s": "C16",
    "mm/min": "H81",
    "m/min": "2X",
    "rad": "C81",
    "deg": "DD",
    "rad/s": "2A",
    "deg/s": "E96",
    "rev/min": "RPM",
    "rev/s": "RPS",
    "N m": "NU",
    "mN m": "D83",
    "N": "NEW",
    "kN": "B47",
    "degC": "CEL",
}
NAMESPACE = "http://www.opcfoundation.org/UA/units/un/cefact"


def code_of_unit(unit: str) -> int:
    """Unit id of OPC UA part 8, 5.6.3: the characters of the common code, first one highest."""
    return int.from_bytes(_CODES[unit].encode(), "big")


def unit_of_code(code: int) -> str | None:
    """Our name of a unit id; None for one that no channel is measured in."""
    return next((unit for unit in _CODES if code_of_unit(unit) == code), None)
