"""Every form that enrols itself, held to one behaviour: read, or refused in one line."""

import random
import tracemalloc
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.recordings.columns import TraceError
from edge_service.recordings.forms import FORMS, HEAD_BYTES, open_source
from edge_service.recordings.reader import open_trace
from edge_service.recordings.sinumerik.signals import ControllerAxis

from .form_files import GREEDY, LYING, RIGHT

AXIS = ControllerAxis(number=None, lead_m=0.01)
NAMES = [form.name for form in FORMS]
RIGHTS = [(name, k) for name in NAMES for k in range(len(RIGHT[name]()) if name in RIGHT else 0)]


def _check_answer(path: Path, folder: Path, capsys) -> int:
    status = main(["convert", str(path), "--out", str(folder / "out.csv")])
    said = capsys.readouterr().err.splitlines()
    assert status in (0, 2), said
    assert len(said) == (1 if status == 2 else 0), said
    return status


def test_every_form_has_right_files_here_and_a_name_of_its_own() -> None:
    assert set(RIGHT) == set(NAMES)
    assert len(set(NAMES)) == len(NAMES) >= 5


@pytest.mark.parametrize(("name", "index"), RIGHTS)
def test_a_right_file_is_known_by_its_content_alone_and_read(name, index, tmp_path, capsys) -> None:
    content = RIGHT[name]()[index]
    path = tmp_path / "recording"
    path.write_bytes(content)
    known = [form.name for form in FORMS if form.recognises(content[:HEAD_BYTES], path)]
    assert known[0] == name
    assert set(known) <= {name, "text (CSV)"}
    assert _check_answer(path, tmp_path, capsys) == 0
    with open_trace(path, axis=AXIS) as reader:
        frames = list(reader)
    assert sum(map(len, frames)) == reader.rows_read == 300
    assert not any(reader.bad_cells.values())
    assert reader.fraction_read == pytest.approx(1.0)
    reader.close()  # safe twice


@pytest.mark.parametrize(("name", "index"), RIGHTS)
def test_a_file_cut_anywhere_is_read_or_refused_in_one_line(name, index, tmp_path, capsys) -> None:
    content = RIGHT[name]()[index]
    for part in range(9):
        path = tmp_path / "recording"
        path.write_bytes(content[: len(content) * part // 9])
        _check_answer(path, tmp_path, capsys)


@pytest.mark.parametrize("name", NAMES)
def test_garbage_behind_a_right_beginning_is_no_traceback(name, tmp_path, capsys) -> None:
    draw = random.Random(name)
    content = RIGHT[name]()[0]
    for start in (20, 130, 300, 1000):
        path = tmp_path / "recording"
        path.write_bytes(content[:start] + draw.randbytes(3000) + content[start:])
        _check_answer(path, tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(GREEDY))
def test_a_file_that_asks_for_too_much_is_refused_within_the_limits(name, tmp_path) -> None:
    path = tmp_path / "recording"
    path.write_bytes(GREEDY[name]())
    tracemalloc.start()
    try:
        with pytest.raises(TraceError) as caught, open_trace(path) as reader:
            list(reader)
        assert tracemalloc.get_traced_memory()[1] < 300e6
    finally:
        tracemalloc.stop()
    assert "\n" not in str(caught.value)
    assert "more than" in str(caught.value)


@pytest.mark.parametrize("name", sorted(LYING))
def test_a_length_beyond_the_file_takes_no_memory(name, tmp_path, capsys) -> None:
    path = tmp_path / "recording"
    path.write_bytes(LYING[name]())
    tracemalloc.start()
    try:
        assert _check_answer(path, tmp_path, capsys) == 2
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", NAMES)
def test_a_source_reads_only_what_is_wanted_and_closes_twice(name, tmp_path) -> None:
    path = tmp_path / "recording"
    path.write_bytes(RIGHT[name]()[0])
    source = open_source(path, AXIS)
    wanted = [source.names[-1]]
    assert source.holds_numbers(wanted[0])
    source.want(wanted)
    block = source.read_block()
    assert block is not None
    assert set(wanted) <= set(block.values) <= {*wanted, "time_s"}
    assert len(block) == len(block.values[wanted[0]]) > 0
    source.close()
    source.close()
