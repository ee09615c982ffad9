"""Runs of a session that its healthy twins repeat."""

import itertools
from dataclasses import replace

import pytest

from edge_service.diagnose.session.twin import LONGEST_TWIN_S, excerpt
from edge_service.models.machine import Machine

from ..conftest import DURATION_S, frame_of, recorded, runs


@pytest.mark.parametrize("count", [1, 7, 8, 180])
def test_a_twin_repeats_all_runs_of_a_short_session_and_some_of_a_long_one(
    machine: Machine, count: int
) -> None:
    (run,) = runs(machine, frame_of(recorded((), seed=3)))
    whole = [replace(run, recording=number) for number in range(count)]
    kept = [each.recording for each in excerpt(whole)]
    if count * DURATION_S <= LONGEST_TWIN_S:
        assert kept == list(range(count))
    else:
        assert len(kept) * DURATION_S < LONGEST_TWIN_S + DURATION_S
        assert len({b - a for a, b in itertools.pairwise(kept)}) == 1
        assert kept[0] == 0
        assert count - kept[-1] <= kept[1]


def test_the_only_run_with_a_channel_is_kept(machine: Machine) -> None:
    (run,) = runs(machine, frame_of(recorded((), seed=3)))
    blind = replace(run, transmission_m=None)
    whole = [blind] * 20 + [run] + [blind] * 20
    assert any(each.transmission_m is not None for each in excerpt(whole))
