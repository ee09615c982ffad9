"""The diagnosis on a benchmark that lies beside the checkout: whole, and with fewer samples.

It makes recordings of a plant of its own, calls the installed command on them and scores the
answers. Nothing of it is imported.
"""

import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..estimator.plants.second_plant import make_recordings, scored
from ..table import Progress, Table
from .figures import Row, figures_table, share, value

MAKE, SCORE = "make.py", "score.py"
THINNED = (2, 4, 10, 20, 40)
"""Every how many rows are kept: of 1 kHz 500, 250, 100, 50 and 25 Hz are left."""
RATE_HZ = 1000.0
CLEAR = 2.0
"""Gap over its noise, by the benchmark's own figure, from which on a single cause is clear."""
NAMELESS = 0.5
"""Probability up to which nothing counts as named where the library lacks the cause."""
_CLAIMS = ("explained", "ambiguous")
_FRICTION = {"drag_error", "viscous_error"}
Case = Mapping[str, Any]


def run_diagnosis_plant(seed: int, quick: bool, say: Progress) -> Table:
    """Make its recordings of one seed, score the answers to them, and tell both as a table.

    Args:
        quick: a dozen cases and two rates instead of ninety and five.

    Raises BenchError where its commands are not there, or one fails.
    """
    with tempfile.TemporaryDirectory(prefix="second-plant-") as home:
        recordings = Path(home) / "recordings"
        make_recordings(MAKE, recordings, seed, quick, say)
        found = scored(SCORE, recordings, f"seed {seed}", say)
        figures = figures_of(found["cases"], found["metrics"])
        for every in THINNED[1::2] if quick else THINNED:
            thinned, name = Path(home) / f"every{every}", f"{RATE_HZ / every:g} Hz"
            thin(recordings, thinned, every)
            figures += slow_figures_of(scored(SCORE, thinned, name, say)["cases"], name)
    return figures_table(figures, (f"second plant beside the checkout, seed {seed}",))


def thin(recordings: Path, out: Path, every: int) -> None:
    """Copy healthy axes and single friction errors with each `every`-th row of their recordings."""
    known = json.loads((recordings / "answers.json").read_text("utf-8"))
    kept = {
        name: case
        for name, case in known["cases"].items()
        if case["kind"] == "control"
        or (case["kind"] == "single" and case["effects"][0] in _FRICTION)
    }
    for name in kept:
        shutil.copytree(recordings / name, out / name, ignore=shutil.ignore_patterns("traces"))
        (out / name / "traces").mkdir()
        for trace in sorted((recordings / name / "traces").glob("*.csv")):
            head, *rows = trace.read_text("utf-8").splitlines()
            thinned = "\n".join([head, *rows[::every]]) + "\n"
            (out / name / "traces" / trace.name).write_text(thinned, "utf-8")
    (out / "answers.json").write_text(json.dumps(known | {"cases": kept}), "utf-8")


def figures_of(cases: Sequence[Case], metrics: Mapping[str, Any]) -> list[Row]:
    """The table of whole recordings; what has no answer counts as wrong."""
    singles = _of_kind(cases, "single")
    clear = [case for case in singles if max(case["snr"].values()) >= CLEAR]
    controls = _of_kind(cases, "control")
    held_out, said = metrics["hold-out"], metrics.get("probability", {})
    return [
        share("singles, clear: named first", ">= 97 %", map(_is_first, clear)),
        share("singles, all strengths: named first", ">= 92 %", map(_is_first, singles)),
        share("doubles: both named", ">= 85 %", map(_are_both, _of_kind(cases, "double"))),
        share(
            "cause that no entry has: unknown, or none above .5",
            ">= 90 %",
            map(_is_nameless, _of_kind(cases, "open")),
        ),
        share("healthy: no_gap", ">= 97 %", (_verdict(each) == "no_gap" for each in controls)),
        share("healthy: falsely attributed", "<= .5 %", map(_claims, controls)),
        value("calibration error", "<= .05", said.get("ece", 0.0), int(said.get("n", 0))),
        value(
            "realised shrink of what an oracle reaches, median",
            ">= 95 %",
            held_out["median_share_of_achievable"] or 0.0,
            int(held_out["share_n"]),
            "%",
        ),
        value(
            "90 % interval of the shrink holds it",
            "85-95 %",
            held_out["coverage"]["rate"] or 0.0,
            int(held_out["coverage"]["n"]),
            "%",
        ),
        value("processor time, median, s", "", metrics["run"]["cpu_median"], len(cases)),
    ]


def slow_figures_of(cases: Sequence[Case], rate: str) -> list[Row]:
    controls = _of_kind(cases, "control")
    singles = _of_kind(cases, "single")
    quiet = (_verdict(each) == "no_gap" for each in controls)
    return [
        share(f"{rate}: friction error named first", "all", map(_is_first, singles)),
        share(f"{rate}: healthy no_gap", "all", quiet),
    ]


def _of_kind(cases: Sequence[Case], kind: str) -> list[Case]:
    return [case for case in cases if case["kind"] == kind]


def _verdict(case: Case) -> str:
    """Verdict of an answer; empty where there is none."""
    return str(case["d"]["verdict"]) if "d" in case else ""


def _claims(case: Case) -> bool:
    return _verdict(case) in _CLAIMS


def _names(case: Case) -> list[str]:
    return [each["name"] for each in case["d"]["effects"]] if _claims(case) else []


def _is_first(case: Case) -> bool:
    return _names(case)[:1] == list(case["effects"][:1])


def _are_both(case: Case) -> bool:
    return set(case["effects"]) <= set(_names(case)[:2])


def _is_nameless(case: Case) -> bool:
    named = case["d"]["effects"] if "d" in case else ()
    likely = max((each["probability"] for each in named), default=0.0)
    return _verdict(case) in ("unknown", "ambiguous") and likely <= NAMELESS
