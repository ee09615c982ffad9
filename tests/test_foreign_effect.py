"""An effect of another package: one file and one entry point, and every room knows it."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.models.effects import registry

from .models.effects import test_effects_round_trip as round_trip

NAME = "spring_load"
MODULE = Path(__file__).parent / "foreign_effect" / f"{NAME}.py"


def install(home: Path, target: str) -> None:
    shutil.copy(MODULE, home / MODULE.name)
    info = home / "foreign_effect-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign-effect\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{registry.ENTRY_POINT_GROUP}]\n{NAME} = {target}\n")


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of the module path; what is installed there is forgotten afterwards."""
    monkeypatch.syspath_prepend(tmp_path)
    registry.effects.cache_clear()
    yield tmp_path
    registry.effects.cache_clear()


@pytest.fixture
def foreign(path: Path) -> Path:
    install(path, f"{NAME}:EFFECT")
    return path


@pytest.mark.usefixtures("foreign")
def test_it_is_simulated_as_its_signatures_say() -> None:
    round_trip.test_torque_differs_as_its_signature_says(NAME, {})
    round_trip.test_transmission_differs_as_its_signature_says(NAME, {})


def test_it_is_named_as_the_cause(foreign: Path) -> None:
    trace, out = str(foreign / "trace.csv"), foreign / "out"
    effect = f"{NAME}:slope_nm_per_m=0.6,centre_m=0.35"
    moved = ["--motion", "production:duration_s=40", "--seed", "3"]
    assert main(["simulate", *moved, "--effect", effect, "--out", trace]) == 0
    assert main(["diagnose", trace, "--out", str(out)]) == 0
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"] == "explained"
    in_torque = [each for each in found["effects"] if each["channel"] == "torque_nm"]
    assert [each["name"] for each in in_torque] == [NAME]
    slope = in_torque[0]["parameters"]["slope_nm_per_m"]
    assert slope["low"] < 0.6 < slope["high"]
    assert main(["gap", "--machine", str(out / "augmented.toml"), trace]) == 0


@pytest.mark.slow
def test_a_motion_says_from_which_strength_it_shows(
    foreign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["motion", "isolability", "friction"]) == 0
    assert NAME in capsys.readouterr().out


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("nowhere:EFFECT", "cannot be loaded"),
        (f"{NAME}:MISSING", "cannot be loaded"),
        (f"{NAME}:Effect", "is not an Effect"),
        ("edge_service.models.effects.library.delay:EFFECT", "uses the name"),
    ],
)
def test_one_that_is_none_is_refused_by_name(path: Path, target: str, said: str) -> None:
    install(path, target)
    with pytest.raises(ValueError, match=f"{target}.*{said}"):
        registry.effects()
