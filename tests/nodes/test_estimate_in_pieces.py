"""A recording in pieces gives the rows of the one in a piece."""

import json
import random
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.recordings.writer import TraceWriter

from .conftest import production

COMMISSIONED = DEFAULT_MACHINE.with_name("commissioned.toml")
MACHINES = {"baseline": DEFAULT_MACHINE, "mixture": COMMISSIONED}


def estimate(trace: Path, machine: Path, *more: str) -> list[str]:
    out = trace.with_name(f"{trace.stem}_estimates.csv")
    told = ["--machine", str(machine), "--out", str(out), *more]
    assert main(["estimate", str(trace), *told]) == 0
    return out.read_text().splitlines()[1:]


def holed(lines: list[str]) -> list[str]:
    """Repeated and missing rows, a gap of 40 ms, and values that are none."""
    rng = random.Random(3)
    kept = []
    for row, line in enumerate(lines):
        if 9_000 <= row < 9_040 or rng.random() < 0.002:
            continue
        kept += [line] * (2 if rng.random() < 0.002 else 1)
        if rng.random() < 0.002:
            fields = kept[-1].split(",")
            kept[-1] = ",".join([fields[0], "nan", *fields[2:]])
    return kept


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("cut", [(7_531,), (3, 12, 900, 9_010, 14_000)])
def test_pieces_give_the_rows_of_the_whole(
    name: str, cut: tuple[int, ...], trace_path: Path, tmp_path: Path
) -> None:
    header, *lines = trace_path.read_text().splitlines()
    lines = holed(lines)
    whole = tmp_path / "whole.csv"
    whole.write_text("\n".join([header, *lines]) + "\n")
    machine, state, rows = MACHINES[name], tmp_path / "axis.state", []
    for number, (begin, end) in enumerate(zip((0, *cut), (*cut, len(lines)), strict=True)):
        piece = tmp_path / f"piece_{number}.csv"
        piece.write_text("\n".join([header, *lines[begin:end]]) + "\n")
        rows += estimate(piece, machine, "--state", str(state))
    expected = estimate(whole, machine)
    assert rows == expected
    assert sum("estimated" in row for row in expected) > 100


@pytest.mark.parametrize("torn", [0, 137])
def test_a_recording_on_a_clock_of_its_own_is_another_day(torn: int, tmp_path: Path) -> None:
    """The estimate goes on from what was known, less surely, and has numbers with the first motion.

    Nothing is left of an interval that the recording before has not ended.
    """
    state, trace = str(tmp_path / "axis.state"), tmp_path / "trace.csv"
    frame = production(load_machine(COMMISSIONED), 6.846, 20_000 - torn)
    with TraceWriter(trace, tuple(frame.channels)) as writer:
        writer.write(frame)
    fresh = estimate(trace, COMMISSIONED, "--state", state)
    again = estimate(trace, COMMISSIONED, "--state", state)
    assert [row.split(",")[0] for row in again] == [row.split(",")[0] for row in fresh]
    first = next(i for i, row in enumerate(again) if ",estimated," in row)
    assert first < next(i for i, row in enumerate(fresh) if ",estimated," in row)


def spoiled_state(folder: Path, trace: Path, name: str) -> Path:
    state = folder / "axis.state"
    estimate(trace, COMMISSIONED, "--state", str(state))
    content = json.loads(text := state.read_text())
    others = {
        "other machine": {"machine": "0" * 64},
        "other axis": {"axis": "Y"},
        "another shape": {"snapshot": []},
    }
    if name in others:
        state.write_text(json.dumps(content | others[name]))
    else:
        state.write_text({"torn": text[:-20], "binary": "\x00\x01"}[name])
    return state


@pytest.mark.parametrize("name", ["torn", "binary", "other machine", "other axis", "another shape"])
def test_a_state_that_is_none_is_refused(
    name: str, trace_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trace = tmp_path / "short.csv"
    trace.write_text("\n".join(trace_path.read_text().splitlines()[:500]) + "\n")
    state = spoiled_state(tmp_path, trace, name)
    before, out = state.read_text(), tmp_path / "refused.csv"
    arguments = ["--machine", str(COMMISSIONED), "--out", str(out), "--state", str(state)]
    assert main(["estimate", str(trace), *arguments]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "--state" in told
    assert not out.exists()
    assert state.read_text() == before


@pytest.mark.parametrize("taken", ["trace", "machine", "out"])
def test_a_state_never_takes_the_place_of_another_file(
    taken: str, trace_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "estimates.csv"
    state = {"trace": trace_path, "machine": COMMISSIONED, "out": out}[taken]
    arguments = ["--machine", str(COMMISSIONED), "--out", str(out), "--state", str(state)]
    assert main(["estimate", str(trace_path), *arguments]) == 2
    assert "overwrite" in capsys.readouterr().err
    assert not out.exists()
