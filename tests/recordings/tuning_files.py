"""Files of a SINUMERIK's servo tuning, written from the public layout (eliasrhoden/Trace-Tools)."""

import struct
from collections.abc import Mapping, Sequence

import numpy as np

ALPHABET = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"


def base85(values: Sequence[float]) -> str:
    """Doubles as digits, four zero bytes as a point."""
    words = struct.unpack(f">{2 * len(values)}I", struct.pack(f">{len(values)}d", *values))
    return "".join(_digits(word) for word in words)


def _digits(word: int) -> str:
    if word == 0:
        return "."
    digits = ""
    for _ in range(5):
        word, digit = divmod(word, 85)
        digits = ALPHABET[digit] + digits
    return digits


def array(name: str, values: Sequence[float], element: str = "double") -> str:
    text = base85(values)
    lines = "\n".join(text[start : start + 200] for start in range(0, len(text), 200))
    return (
        f'<NumericArray elementtype="{element}" format="base85" name="{name}">'
        f'<raw name="m_pNumberArray"><![CDATA[\n{lines}\n]]></raw></NumericArray>'
    )


def curve(tag: str, name: str, frequency_hz: np.ndarray, values: np.ndarray) -> str:
    parts = np.asarray(values, dtype=complex).view(float).tolist()
    return (
        f'<{tag} name="{name}">{array("m_ValueVector", parts, "ComplexNumber")}'
        f"{array('m_FrequencyVector', frequency_hz.tolist())}</{tag}>"
    )


def tuning(
    frequency_hz: np.ndarray,
    response: np.ndarray,
    coherence: np.ndarray,
    stated: Mapping[str, float] | None = None,
    before: str = "",
) -> str:
    """Auto servo tuning of axis AX1."""
    said = "".join(f'<float name="{name}">{each}</float>' for name, each in (stated or {}).items())
    return (
        f'<?xml version="1.0" encoding="ISO-8859-1"?>{before}<DynamicModelAxisController>'
        '<unsigned_int name="m_uAxis">7</unsigned_int><string name="m_szAxisName">AX1</string>'
        f'<DynamicModelList name="m_SpeedControllerList">{said}'
        '<LinkedList name="m_listMechPlants">'
        f"{curve('FrequencyResponseFunction', 'm_pPlant', frequency_hz, response)}"
        f"{curve('FrequencyResponseFunction', 'm_pMeasCoherence', frequency_hz, coherence)}"
        "</LinkedList></DynamicModelList></DynamicModelAxisController>"
    )


def measurement(frequency_hz: np.ndarray, spectra: Sequence[np.ndarray]) -> str:
    """A measured response: own, cross and own spectrum."""
    curves = "".join(curve("CrossSpectrum", "", frequency_hz, each) for each in spectra)
    return (
        '<?xml version="1.0" encoding="ISO-8859-1"?><ResponseTestCustom>'
        f'<unsigned_int name="m_uAxis">1</unsigned_int>{curves}</ResponseTestCustom>'
    )
