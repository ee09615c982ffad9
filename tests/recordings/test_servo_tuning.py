"""Servo tuning of a SINUMERIK: base 85, responses with their coherence, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.recordings.columns import TraceError
from edge_service.recordings.sinumerik.tuning import doubles_from_base85, read_tuning

from .tuning_files import base85, measurement, tuning

FREQUENCY = np.array([0.5, 1.0, 2.0, 4.0])
RESPONSE = np.array([1.0, 0.5j, -0.25, 1e-3 - 2j])
LAGGING = np.array([-1j, -0.5j, 0.1 - 0.25j, 1e-3 + 2j])
COHERENCE = np.array([0.0, 0.5, 1.0, 0.9])


def _read(tmp_path: Path, text: str):
    path = tmp_path / "tuning.xml"
    path.write_text(text, encoding="latin-1")
    return read_tuning(path)


@settings(deadline=None)
@given(st.lists(st.floats(), max_size=20))
def test_doubles_come_back_bit_for_bit(values: list[float]) -> None:
    found = doubles_from_base85(base85(values))
    assert found.tobytes() == np.array(values, dtype=np.float64).tobytes()


@pytest.mark.parametrize("text", ["kI]nm", "%" * 10, "~" * 10, "kI]nm*9lJ", "é" * 10])
def test_what_are_no_doubles_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        doubles_from_base85(text)


def test_a_tuning_gives_its_response_and_what_it_states(tmp_path: Path) -> None:
    stated = {"m_dTotalInertia": 0.25, "m_dMotorInertia": 0.0, "m_uNumberOfAverages": 21}
    found = _read(tmp_path, tuning(FREQUENCY, RESPONSE, COHERENCE, stated))
    assert found.frequency_hz.tolist() == FREQUENCY.tolist()
    assert found.response.tolist() == RESPONSE.tolist()
    assert found.coherence.tolist() == COHERENCE.tolist()
    assert (found.axis, found.unit, found.averages) == ("AX1", "rad/(s N m)", 21.0)
    assert found.stated == {"total_inertia_kg_m2": 0.25}


def test_a_measurement_is_the_own_spectrum_over_the_cross_spectrum(tmp_path: Path) -> None:
    source = np.full(4, 2.0 + 0j)
    output = np.abs(LAGGING) ** 2 * source
    for cross in (output / LAGGING, output / np.conj(LAGGING)):
        found = _read(tmp_path, measurement(FREQUENCY, [output, cross, source]))
        np.testing.assert_allclose(found.response, LAGGING, rtol=1e-12)
    np.testing.assert_allclose(found.coherence, 1.0, rtol=1e-12)
    assert (found.axis, found.unit) == ("1", "")


WHOLE = tuning(FREQUENCY, RESPONSE, COHERENCE)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no element found"),
        ("<html/>", "expected a SINUMERIK auto servo tuning"),
        (WHOLE[:900], "cut off or damaged"),
        (WHOLE.replace("m_pPlant", "m_pOther"), "no measured response of the mechanics"),
        (WHOLE.replace("m_pMeasCoherence", "m_pOther"), "without its coherence"),
        (WHOLE.replace('format="base85"', 'format="hex"'), "in the form 'hex'"),
        (WHOLE.replace("CDATA[\n", "CDATA[\n&", 1), "no whole number of doubles"),
        (tuning(FREQUENCY[::-1], RESPONSE, COHERENCE), "frequencies do not rise"),
        (tuning(FREQUENCY, RESPONSE[:3], COHERENCE), "4 frequencies and 3 values"),
        (tuning(FREQUENCY, RESPONSE, COHERENCE + 0.5), "a coherence that is not between"),
        (tuning(FREQUENCY, RESPONSE * np.nan, COHERENCE), "a response without a number"),
        (tuning(FREQUENCY, RESPONSE, COHERENCE, None, "<!DOCTYPE a []>"), "a document type"),
        ("<DynamicModelAxisController>" + "<a>" * 200, "elements more than 64 deep"),
        ("<?xml version='1.0' encoding='utf-16'?><a/>", "encoding 'utf-16'"),
        (measurement(FREQUENCY, [RESPONSE]), "1 spectra; expected own, cross and own"),
    ],
)
def test_what_is_no_response_is_told_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(TraceError) as caught:
        _read(tmp_path, text)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_element_without_an_end_is_refused_before_it_fills_the_memory(tmp_path: Path) -> None:
    with pytest.raises(TraceError, match="more than 33554432 bytes"):
        _read(tmp_path, "<DynamicModelAxisController><raw>" + "1" * (33 << 20))
