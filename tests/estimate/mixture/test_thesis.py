"""The mixture estimator on the thesis' own plant."""

from edge_service.offline.reproduce.simulation import ThesisCase, run_case

from ...bench.estimator.plants.thesis import thesis_blocks, thesis_estimator, thesis_machine
from .production import run


def test_the_drop_of_the_thesis_is_seen_in_the_third_informative_step() -> None:
    """Steps in which the drag may hold the axis tell nothing."""
    simulated, _ = run_case(ThesisCase(4), seed=3)
    blocks = thesis_blocks(simulated)
    estimator = thesis_estimator(thesis_machine())
    percents = {e.time_s: e.preload_percent for e in run(blocks, estimator)}
    before = [p for time_s, p in percents.items() if 10.0 < time_s < 50.15 and p is not None]
    assert min(before) > 9.5
    informative = [block.time_s for block in blocks if block.time_s > 50.15 and block.phases]
    after = [percents[time_s] for time_s in informative[2:]]
    assert max(p for p in after if p is not None) < 5.0
