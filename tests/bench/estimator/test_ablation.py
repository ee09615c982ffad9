"""The table of ablations: each row changes what it says, and every plant has its own figures."""

from pathlib import Path

import pytest

from edge_service.estimate.mixture.model import MixtureSettings

from ..life import bench as life_bench
from . import ablation
from .ablation import (
    VARIANTS,
    WHOLE,
    Ablated,
    ablation_section,
    on_foreign_axis,
    on_life,
)
from .bench import run_estimator_bench
from .scores import Score
from .tasks import BenchSettings


def of(mae: float) -> Score:
    return Score(10, 10, mae=mae, wrong=0.1, interval_score=2.0)


def test_each_variant_is_another() -> None:
    assert VARIANTS[WHOLE] == MixtureSettings()
    assert len(set(VARIANTS.values())) == len(VARIANTS)


def test_a_row_has_the_figures_of_every_plant() -> None:
    parts = [
        Ablated(plant, variant, of(mae))
        for plant, variant, mae in (
            ("foreign", WHOLE, 0.1),
            ("foreign", WHOLE, 0.3),
            ("foreign", "no LOSS", 0.5),
            ("second", WHOLE, 0.4),
            ("second", "no LOSS", 0.6),
        )
    ]
    section = ablation_section(parts)
    assert section.heads[0] == "MAE, foreign"
    assert section.heads[3] == "MAE, second"
    rows = dict(section.rows)
    assert rows[WHOLE][0] == pytest.approx(0.2)
    assert rows["no LOSS"][3] == pytest.approx(0.6)
    assert [row["row"] for row in section.as_dict()["rows"]] == [WHOLE, "no LOSS"]
    assert "recordings: foreign 2, second 1;" in section.notes[0]


def test_the_variants_follow_the_foreign_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short healthy recording; one that knows no drift is surer than one that knows much."""
    changed = {
        "none": MixtureSettings(together=0.001, apart=0.001),
        "much": MixtureSettings(together=0.3),
    }
    monkeypatch.setattr(ablation, "VARIANTS", changed)
    short = {"healthy": {"duration_s": 15.0}}
    monkeypatch.setattr(ablation, "scenarios", lambda *_: short)
    parts = on_foreign_axis(3, True)
    assert [part.variant for part in parts] == ["none", "much"]
    assert all(part.score.answered > 20 for part in parts)
    assert parts[0].score.interval_score < parts[1].score.interval_score


def test_the_variants_follow_a_life_with_the_state_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two short sessions; one that expects more to change is less sure."""
    changed = {"usual": MixtureSettings(), "wide": MixtureSettings(start=1.0, together=0.4)}
    monkeypatch.setattr(ablation, "VARIANTS", changed)
    monkeypatch.setattr(life_bench, "QUICK_SESSIONS", 2)
    monkeypatch.setattr(life_bench, "QUICK_SESSION_S", 12.0)
    parts = on_life(4, "healthy", True)
    assert [(part.plant, part.variant) for part in parts] == [("lives", "usual"), ("lives", "wide")]
    assert all(part.score.answered > 20 for part in parts)
    assert parts[0].score.interval_score < parts[1].score.interval_score


def test_a_plant_that_is_not_there_is_said_to_be_missing(tmp_path: Path) -> None:
    settings = BenchSettings(parts=("second-plant",), second_plant=tmp_path)
    found = run_estimator_bench(settings)
    assert found.sections == ()
    assert "not measured" in found.unmeasured[0]
