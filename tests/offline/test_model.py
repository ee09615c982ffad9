"""`edge-service model` beside the thesis' printed values and closed forms; misprints are named."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import loadmat

from edge_service.cli.entry import cli
from edge_service.config import DEFAULT_MACHINE, ConfigError, load_machine
from edge_service.messages.samples import Floats
from edge_service.models.plant.from_machine import chain
from edge_service.models.screw.ball_screw import (
    lead_angle,
    preload_drag,
    screw_inertia,
    table_inertia,
    transmission_ratio,
)
from edge_service.offline.machine_text import drag_of, stated
from edge_service.offline.model import computed, machine_of, model

MACHINE = load_machine(DEFAULT_MACHINE)
KGF_CM_NM = 0.0980665


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    return computed(MACHINE, 1000.0)


@pytest.mark.parametrize(
    ("printed", "value"),
    [
        ("1.26e-4", screw_inertia(0.02, 1.0)),  # Table 4.1
        ("2e-4", table_inertia(20.0, 0.02)),  # (4.3.2) lacks a square at its 2 pi
        ("3.3e-3", 3e-3 + screw_inertia(0.02, 1.0) + table_inertia(20.0, 0.02)),  # (4.3.3)
        ("1.59e-3", 0.5 * transmission_ratio(0.02)),  # Table 4.1 prints half of (4.3.5)
        ("0.3", preload_drag(1e3, 0.02, 0.31)),
        ("17.17", math.degrees(lead_angle(0.02, 0.0206))),  # Table A.1
    ],
)
def test_values_are_those_printed(printed: str, value: float) -> None:
    digits = len(printed.split("e", maxsplit=1)[0].replace(".", "").lstrip("0"))
    assert float(f"{value:.{digits}g}") == float(printed)


def test_the_drag_of_table_a_1_is_in_kgf_cm_and_not_in_n_m() -> None:
    assert 1.18 < preload_drag(510.0, 0.02, math.radians(17.17)) / KGF_CM_NM < 1.77


def test_stiffnesses_are_in_series_along_the_stroke(found: dict[str, Any]) -> None:
    rigidity_n, along = 2.06e11 * math.pi * 0.01**2, found["stiffness"]
    nut = 0.8 * 1.6e8 * (510.0 / 745.0) ** (1.0 / 3.0)  # (5.3.11)
    rest = 1.0 / along["coupling_n_per_m"] + 1.0 / nut
    bearing, length_m = 1.0 / along["bearing_n_per_m"], MACHINE.axis.screw_length_m or 0.0
    for place_m, free, fixed in zip(
        along["place_m"], along["fixed_free_n_per_m"], along["fixed_fixed_n_per_m"], strict=True
    ):
        near, far = bearing + place_m / rigidity_n, bearing + (length_m - place_m) / rigidity_n
        assert 1.0 / free == pytest.approx(near + rest)  # (5.3.2), (5.3.9)
        assert 1.0 / fixed == pytest.approx(near * far / (near + far) + rest)  # (5.3.10)


def test_a_preload_stiffens_a_nut_until_its_load_frees_other_half(found: dict[str, Any]) -> None:
    nut, fresh = found["nut"], 0.8 * 1.6e8
    assert nut["unloaded_n_per_m"][2] == pytest.approx(fresh * 0.5 ** (1.0 / 3.0), rel=1e-6)
    last_n = nut["load_n"][-1]  # beyond 2.8 times each preload but the greatest
    alone = 0.5 * fresh * (last_n / 745.0) ** (1.0 / 3.0)  # one Hertz contact, F = c d^1.5
    for level in ("7.5", "5", "2.5", "0"):
        assert nut[f"at_{level}_percent_n_per_m"][-1] == pytest.approx(alone, rel=1e-3)
    assert nut["unloaded_n_per_m"][-1] == nut["at_0_percent_n_per_m"][0] == 0.0
    assert nut["at_10_percent_n_per_m"][1] > nut["at_2.5_percent_n_per_m"][1]


def test_poles_and_zeros_are_those_of_5_3_19_without_its_misprints(found: dict[str, Any]) -> None:
    two = found["two_mass"]
    a, motor = np.array(two["a"]), 1.0 / two["b"][2][0]
    d2, table = MACHINE.model.viscous_nm_s_per_rad.value, 1.0 / two["b"][3][1]
    k, d1 = -a[2, 0] * motor, a[2, 3] * motor
    cubic = (d1 * (motor + table) + d2 * table, k * (motor + table) + d1 * d2, k * d2, 0.0)
    expected = np.sort_complex(np.roots([motor * table, *cubic]))
    poles = np.sort_complex(np.array(two["poles_rad_s"]) @ [1.0, 1j])
    np.testing.assert_allclose(poles, expected, rtol=1e-6, atol=1e-6)
    assert two["zeros_1_rad_s"][0] == pytest.approx([-k / d1, 0.0])
    zeros = np.array(two["zeros_0_rad_s"]) @ [1.0, 1j]
    np.testing.assert_allclose(np.abs(zeros), math.sqrt(k / table), rtol=1e-6)
    held_hz = found["frequency_hz"]["motor_held"][2]
    assert held_hz == pytest.approx(math.sqrt(k / table) / (2.0 * math.pi))


def test_one_mass_has_its_closed_forms(found: dict[str, Any]) -> None:
    one, inertia = found["one_mass"], MACHINE.model.inertia_kg_m2.value
    damping = MACHINE.model.viscous_nm_s_per_rad.value
    left = math.exp(-damping / inertia / 1000.0)
    assert one["z_denominator"] == pytest.approx([1.0, -1.0 - left, left])
    s = 2j * math.pi * np.array(one["frequency_hz"])
    size = np.abs(1.0 / (inertia * s**2 + damping * s))  # (5.3.16)
    np.testing.assert_allclose(np.array(one["magnitude"])[:, 0], size, rtol=1e-9)
    time_s, constant_s = np.array(one["step_s"]), inertia / damping
    angle = (time_s - constant_s * (1.0 - np.exp(-time_s / constant_s))) / damping
    np.testing.assert_allclose(np.array(one["step"])[:, 0], angle, rtol=1e-6, atol=1e-12)


def test_three_masses_are_5_3_8_with_its_missing_plus() -> None:
    (m1, m2, m3), (k1, k2) = (2.0, 3.0, 5.0), (700.0, 1100.0)
    system, s = chain([m1, m2, m3], [(k1, 0.0), (k2, 0.0)], [0.0] * 3), 3.0 + 4.0j
    right = (m2 * s**2 + k1 + k2) * (m3 * s**2 + k2) - k2**2
    below = -k1 * (m3 * s**2 + k2)
    expected = k1 * k2 / ((m1 * s**2 + k1) * right + k1 * below)
    shown = system.c @ np.linalg.solve(s * np.eye(6) - system.a, system.b)
    assert shown[2, 0] == pytest.approx(expected)


def test_the_component_model_carries_torque_and_force_to_both_sides(found: dict[str, Any]) -> None:
    def matrix(name: str) -> Floats:
        return np.array(found["component"][name])

    ratio, mass_kg = transmission_ratio(0.02), 20.0
    motor = 1.5e-3 - mass_kg * ratio**2
    momentum = np.array([0.0, 0.0, motor, mass_kg * ratio])  # springs leave it as it is
    damping = MACHINE.model.viscous_nm_s_per_rad.value
    np.testing.assert_allclose(momentum @ matrix("a"), [0, 0, -damping, 0], atol=1e-9)
    np.testing.assert_allclose(momentum @ matrix("b"), [1.0, ratio], rtol=1e-9)
    assert matrix("c").argmax(axis=1).tolist() == [0, 2, 1, 3]


def test_a_data_sheet_takes_its_place_in_the_machine_file() -> None:
    machine = machine_of(MACHINE, stated("20x10 C7450 P510", None, ()), 1.0)
    drag_nm = 0.05 / math.sqrt(0.01 / (math.pi * 0.02)) * 510.0 * 0.01 / (2.0 * math.pi)
    assert machine.fresh_drag_nm == pytest.approx(drag_nm)
    less = 20.0 * (0.02**2 - 0.01**2) / (2.0 * math.pi) ** 2  # of the table, by half the lead
    assert machine.model.inertia_kg_m2.value == pytest.approx(1.5e-3 - less)
    told = computed(machine, 1000.0, 1.0)["drag"]["stated_is_of_n"]
    assert told == pytest.approx(510.0)
    written = drag_of({"preload_n": 1500.0, "screw_diameter_m": 0.032}, 0.01)
    assert written is not None
    by_hand_nm = 0.05 / math.sqrt(0.01 / (math.pi * 0.032)) * 1500.0 * 0.01 / (1.8 * math.pi)
    assert written.value == pytest.approx(by_hand_nm, rel=2e-3)


def test_what_is_exported_is_what_is_printed(tmp_path: Path) -> None:
    files = [tmp_path / f"model.{kind}" for kind in ("mat", "npz", "csv")]
    for file in files:
        picture = str(tmp_path / "model.png")
        said = CliRunner().invoke(cli, ["model", "--export", str(file), "--plot", picture])
        assert said.exit_code == 0, said.output
        assert "frequency_hz_free" in said.output
    loaded, packed = loadmat(files[0]), np.load(files[1])
    with packed, files[2].open() as file:
        rows = {name: values for name, *values in csv.reader(file)}
        sums = [float(np.ravel(each["inertia_kg_m2_sum"])[0]) for each in (loaded, packed, rows)]
    assert sums == [1.5e-3] * 3
    assert (tmp_path / "model.png").stat().st_size > 10_000
    with pytest.raises(ConfigError, match=r"\.mat, \.npz or \.csv"):
        model(MACHINE, 1000.0, export=tmp_path / "model.txt")
