"""The guide to the first machine, carried out command by command; and what carries it out."""

import math
import os
import sys
import tomllib
from pathlib import Path

import pytest

from edge_service.models.machine import Machine
from edge_service.models.screw.ball_screw import lead_angle, table_inertia
from tests.documents import ROOT, block, document
from tests.drivers.bench import free_port

from .tour import carry_out, steps

TOURS = ("deploy/FIRST_MACHINE.md",)


def environment() -> dict[str, str]:
    """Shell of a reader: the command is on the path, and this checkout is what it runs."""
    return os.environ | {
        "PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin",
        "PYTHONPATH": str(ROOT),
    }


@pytest.mark.slow
@pytest.mark.parametrize("path", TOURS)
def test_every_command_of_a_tour_answers_as_it_says(path: str, tmp_path: Path) -> None:
    text = document(path)
    for port in ("8080", "7447"):
        text = text.replace(port, str(free_port()))
    assert carry_out(steps(text), tmp_path, environment()) == []


@pytest.mark.parametrize("path", TOURS)
def test_every_command_of_a_tour_has_an_answer(path: str) -> None:
    tour = steps(document(path))
    assert len(tour) > 5
    silent = [step.commands for step in tour if step.excerpt is None]
    assert silent == []


@pytest.mark.parametrize("answer", ["two = 3", "two = 2\none = 1", "one = 1 two = 2 three"])
def test_what_a_tour_says_wrongly_is_found(answer: str, tmp_path: Path) -> None:
    text = f"```sh\nprintf 'one = 1\\ntwo = 2'\n```\n\n```text\n{answer}\n```\n"
    (wrong,) = carry_out(steps(text), tmp_path, environment())
    assert "was said to print" in wrong


def test_the_worked_example_follows_from_its_data_sheet() -> None:
    """By the formulas that the guide states beside it, and by the figures of its table."""
    machine = Machine.model_validate(tomllib.loads(block(TOURS[0], "toml", "lead_m")))
    lead_m, model = machine.axis.lead_m, machine.model
    assert model.preload_n
    assert model.preload_drag_nm
    assert model.table_mass_kg
    share = 0.05 / math.sqrt(math.tan(lead_angle(lead_m, 0.033)))
    drag_nm = share * model.preload_n.value * lead_m / (2.0 * math.pi)
    assert model.preload_drag_nm.value == pytest.approx(drag_nm, rel=2e-3)
    inertia_kg_m2 = 2.47e-3 + 0.97e-3 + table_inertia(model.table_mass_kg.value, lead_m)
    assert model.inertia_kg_m2.value == pytest.approx(inertia_kg_m2, rel=2e-3)
    guides_nm = model.guide_force_n.value * lead_m / (2.0 * math.pi)
    friction_nm = drag_nm + guides_nm + model.bearing_drag_nm.value
    assert friction_nm == pytest.approx(0.67, abs=1e-2)
    assert model.preload_n.value == 0.05 * (machine.axis.dynamic_load_rating_n or 0.0)
