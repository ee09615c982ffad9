"""A worn screw is not learned as fresh; where the data sheet cannot tell, it is asked about."""

from dataclasses import replace
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.config import load_machine
from edge_service.estimate.commissioning.identification import commissioned
from edge_service.estimate.commissioning.shares import Doubt, doubt_of_fresh_screw
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.estimate import PreloadEstimate
from edge_service.recordings.writer import TraceWriter

from .plain_axis import PlainAxis
from .test_commissioning_checks import BENCH, HEAVY, SMALL, cut

ONE = replace(BENCH, one_encoder=True)
OTHERS = {"guide_force_n": BENCH.guide_n, "bearing_drag_nm": BENCH.bearing_nm}
FRESH = {"preload_drag_nm": BENCH.screw_nm}
HALF_NM = 0.5 * BENCH.screw_nm
SHOWN: dict[str, tuple[PlainAxis, dict[str, float]]] = {
    "two encoders": (BENCH, {}),
    "lead 5": (SMALL, {}),
    "400 kg upright": (HEAVY, {}),
    "one encoder, others stated": (ONE, OTHERS),
    "one encoder and nothing else": (replace(ONE, guide_n=0.0, bearing_nm=0.0), {}),
}
DOUBTED: dict[str, tuple[PlainAxis, dict[str, float], str]] = {
    "half": (replace(BENCH, screw_nm=HALF_NM, bearing_nm=0.04), FRESH, "worn, warm"),
    "one encoder, others not stated": (ONE, {}, "lost; state model.guide_force_n"),
    "one encoder, guide stated": (ONE, {"guide_force_n": 1.0}, "lost; state more closely model"),
    "one encoder, half": (replace(ONE, screw_nm=HALF_NM), FRESH, "may be guides and bearings"),
    "one encoder, others stated, a fifth": (
        *(replace(ONE, screw_nm=0.8 * BENCH.screw_nm), FRESH | OTHERS, "worn, warm"),
    ),
}


def doubt(axis: PlainAxis, stated: dict[str, float]) -> Doubt | None:
    nominal = axis.machine(**stated)
    return doubt_of_fresh_screw(nominal, commissioned([cut(axis)], nominal))


@pytest.mark.parametrize(("axis", "stated"), SHOWN.values(), ids=SHOWN)
def test_a_fresh_screw_is_seen_to_be_fresh(axis: PlainAxis, stated: dict[str, float]) -> None:
    assert doubt(axis, stated) is None


@pytest.mark.parametrize(("axis", "stated", "reason"), DOUBTED.values(), ids=DOUBTED)
def test_what_may_be_worn_is_asked_about(
    axis: PlainAxis, stated: dict[str, float], reason: str
) -> None:
    found = doubt(axis, stated)
    assert found is not None and reason in found.words
    assert found.contradicts == (reason == "worn, warm")


@pytest.mark.parametrize("left", [0.9, 0.8, 0.7])
def test_less_friction_than_at_last_commissioning_is_assumed_to_be_fresh_aloud(left: float) -> None:
    nominal = BENCH.machine(**FRESH)
    known = commissioned([cut(BENCH)], nominal)
    assert doubt_of_fresh_screw(known, commissioned([cut(BENCH)], known)) is None
    worn = replace(BENCH, screw_nm=left * BENCH.screw_nm)
    found = doubt_of_fresh_screw(known, commissioned([cut(worn)], known))
    assert found is not None and not found.contradicts
    assert "less than the machine file states" in found.words


def test_an_assumption_is_handed_on() -> None:
    """Learned again, the frictions of a worn screw are those that the file states."""
    known = commissioned([cut(BENCH)], BENCH.machine(**FRESH))
    assert known.commissioned is not None
    learned = known.commissioned.model_copy(update={"assumed_fresh": True})
    assumed = known.model_copy(update={"commissioned": learned})
    found = doubt_of_fresh_screw(assumed, commissioned([cut(BENCH)], assumed))
    assert found is not None and "assumption" in found.words and not found.contradicts


def commission(folder: Path) -> Path:
    """Machine file that the command writes for an axis with one encoder."""
    frame, trace, nominal = ONE.frame(), folder / "t.parquet", folder / "m.toml"
    with TraceWriter(trace, tuple(frame.channels)) as writer:
        writer.write(frame)
    nominal.write_text(
        f"[axis]\nlead_m = {ONE.lead_m}\ndynamic_load_rating_n = 7450.0\n"
        f"[model]\ninertia_kg_m2 = {ONE.inertia_kg_m2}\npreload_n = 500.0\n"
        f"preload_drag_nm = {ONE.screw_nm}\n"
    )
    out = folder / "out.toml"
    command = ["commission", "--machine", str(nominal), str(trace), "--out", str(out)]
    assert main(command) == 0
    return out


def test_what_was_assumed_stays_in_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    learned = load_machine(commission(tmp_path)).commissioned
    assert learned is not None and learned.assumed_fresh
    said = capsys.readouterr().out
    assert "the screw is assumed to be fresh" in said
    assert "reads as" not in said


def test_a_recording_that_does_not_read_as_fresh_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    estimate = MixturePreloadEstimator.estimate

    def low(estimator: MixturePreloadEstimator) -> PreloadEstimate:
        percent = 0.9 * 100.0 * 500.0 / 7450.0
        numbers = {"preload_percent": percent, "low": percent - 0.5, "high": percent + 0.5}
        return estimate(estimator).model_copy(update=numbers)

    monkeypatch.setattr(MixturePreloadEstimator, "estimate", low)
    commission(tmp_path)
    assert "t.parquet reads as 90 % of the fresh preload (82 to 98)" in capsys.readouterr().out
