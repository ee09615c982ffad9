"""`check-diagnosis` hides effects that anybody may choose, and `--without` takes one away."""

import json
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.config import DEFAULT_MACHINE
from edge_service.diagnose.result import ChannelGap, Diagnosis, NamedEffect, ReplayStatus, Verdict

from ..hidden_effects.cases import HiddenCase, Plant, foreign_plant, own_plant, plan
from ..hidden_effects.score import CheckedCase, totals_of


def answer(
    causes: tuple[str, ...],
    verdict: str = "explained",
    withheld: tuple[str, ...] = (),
    **named: float,
) -> CheckedCase:
    """Answer to a case: each name claims a shrink of 80 % (70 to 90), and 75 % come true."""
    effects = [
        NamedEffect.model_validate(
            {"name": name, "channel": "torque_nm", "probability": p, "class": (name,)}
            | {"shrink": {"estimate": 0.8, "low": 0.7, "high": 0.9}}
            | {"parameters": {}, "entries": ()}
        )
        for name, p in named.items()
    ]
    found = Diagnosis(
        verdict=Verdict(verdict),
        gap={"torque_nm": ChannelGap(before=4.0, after=1.2, noise_floor=1.0, unit="N m")},
        effects=tuple(effects),
        replay=ReplayStatus(possible=True, reason=None),
    )
    case = HiddenCase(causes, 1.0, "full", len(causes), withheld)
    return CheckedCase(case, found, dict.fromkeys(named, 0.75), {"torque_nm": (4.0, 1.3)})


@pytest.mark.parametrize(
    ("row", "outcome"),
    [
        (answer(("backlash",), backlash=0.95), "named"),
        (answer(("backlash:width_m=4e-6",), backlash=0.95), "named"),
        (answer(("backlash", "delay"), backlash=0.95), "in part"),
        (answer(("backlash",), stribeck=0.95), "wrong"),
        (answer(("backlash",), "unknown"), "unknown"),
        (answer(("backlash",), "no_gap"), "missed"),
        (answer((), "no_gap"), "quiet"),
        (answer((), backlash=0.4), "wrong"),
        (answer(("stuck_seal",), "unknown", stribeck=0.3), "rightly unknown"),
        (answer(("backlash",), "unknown", ("backlash",)), "rightly unknown"),
        (answer(("backlash",), withheld=("backlash",), stribeck=0.95), "wrong"),
    ],
)
def test_an_answer_is_one_word_beside_the_truth(row: CheckedCase, outcome: str) -> None:
    assert row.outcome == outcome
    assert row.words.startswith(f"{outcome}: ")


def test_totals_hold_claims_against_what_came_true() -> None:
    rows = [answer(("backlash",), backlash=0.95), answer(("backlash",), stribeck=0.95)]
    totals = totals_of(rows)
    assert totals["outcomes"] == {"single": {"named": 1, "wrong": 1}}
    assert (totals["claimed_shrink_share"], totals["realised_shrink_share"]) == (0.8, 0.75)
    assert totals["realised_of_possible_share"] == pytest.approx((4.0 - 1.3) / (4.0 - 1.0))
    assert (totals["shrinks"], totals["shrinks_in_interval"]) == (1, 1)
    assert totals["calibration_error_share"] == pytest.approx(0.45)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--effect", "stribek"], "no effect 'stribek'; did you mean 'stribeck'?"),
        (["--plant", "own", "--effect", "lead"], "no effect 'lead'; the plant has"),
        (["--plant", "own", "--effect", "delay:lag_s=x"], "expected key=number"),
        (["--effect", "delay:lag_s=0.001"], "a foreign plant draws the values"),
        (["--without", "backlas"], "no effect 'backlas'; did you mean 'backlash'?"),
        (["--machine", str(DEFAULT_MACHINE)], "--machine: the foreign plant has"),
    ],
)
def test_a_bad_name_is_one_line(
    given: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check-diagnosis", *given]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_line_is_printed_as_soon_as_its_case_ends(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = list[str]()

    def checked(_plant: Plant, case: HiddenCase) -> CheckedCase:
        printed.append(capsys.readouterr().out)
        return answer(case.causes, backlash=0.95)

    monkeypatch.setattr("hidden_effects.score.checked", checked)
    assert main(["check-diagnosis", "--plant=own", "--effect=backlash", "--cases=2"]) == 0
    assert [each.partition(":")[0] for each in printed] == ["", "named"]


def test_the_foreign_plant_is_installed_with_the_command() -> None:
    (entry,) = entry_points(group="edge_service.commands")
    assert not entry.value.startswith("tests")
    plant = foreign_plant()
    assert {"backlash", "stribeck"} <= set(plant.known)
    assert not set(plant.known) & set(plant.odd)


def test_a_seed_draws_the_same_cases_and_the_same_axis_moves_anew() -> None:
    plant = own_plant()
    cases = plan(plant, 16, 3)
    assert cases == plan(plant, 16, 3)
    assert cases != plan(plant, 16, 4)
    assert {len(case.causes) for case in cases} == {0, 1, 2, 3}
    assert all(case.withheld in ((), case.causes) for case in cases)
    case = replace(cases[1], causes=("torque_ripple",))
    one, same, other = (plant.recorded(case, "production", seed) for seed in (5, 5, 6))
    assert np.array_equal(one.channels["torque_command_nm"], same.channels["torque_command_nm"])
    setpoint = "position_setpoint_m"
    assert not np.array_equal(one.channels[setpoint], other.channels[setpoint])


@pytest.mark.slow
@pytest.mark.smoke
def test_what_is_hidden_is_named_and_shrinks_another_recording(
    capsys: pytest.CaptureFixture[str],
) -> None:
    line = ["check-diagnosis", "--plant", "own", "--effect", "drag_error", "--cases=1", "--jobs=2"]
    assert main([*line, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    (case,) = document["cases"]
    assert (case["truth"], case["outcome"]) == (["drag_error"], "named")
    gap = case["gap"]["torque_nm"]
    assert gap["after"] < 0.5 * gap["before"]
    assert document["totals"]["outcomes"] == {"single": {"named": 1}}


@pytest.mark.slow
def test_a_library_that_lacks_the_cause_never_names_it(tmp_path: Path) -> None:
    trace, out = tmp_path / "trace.csv", tmp_path / "out"
    assert main(["simulate", "--effect", "warmup", "--motion=friction", "--out", str(trace)]) == 0
    assert main(["diagnose", "--without", "warmup", str(trace), "--out", str(out)]) == 0
    found = json.loads((out / "diagnosis.json").read_text())
    assert "warmup" in own_plant().known
    assert not any("warmup" in {each["name"], *each["class"]} for each in found["effects"])
