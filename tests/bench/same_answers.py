"""Answers of the commands before and after a change that is to change none of them.

    python -m tests.bench.same_answers record FOLDER
    python -m tests.bench.same_answers check FOLDER [--only own_1_friction ...]

`record` makes recordings (own and foreign plant; a second plant and real machines where they lie
beside the checkout) and keeps what the commands say of them; `check` asks again and compares byte
by byte. Pages and pictures are not compared. Exit status 1 where an answer differs.
"""

import argparse
import filecmp
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from .. import foreign_plant
from .real_machines import (
    ACTUATOR_TOML,
    SCREW_TOML,
    milling_machine,
    recordings,
    screw_actuator,
    written,
)

ROOT = Path(__file__).parents[2]
BESIDE = ROOT.parent / "shared"
COMPARED = {".json", ".csv", ".toml", ".txt"}
MOTIONS = ("friction", "acceleration", "production:duration_s=60")
SECOND = 4
"""Cases of the second plant, five recordings each."""
CAUSES = ("", "drag_error:change_nm=0.1", "compliance:level_m_per_n=2e-8")


@dataclass(frozen=True)
class Recorded:
    """A machine file and recordings of that machine."""

    name: str
    machine: Path
    traces: tuple[Path, ...]
    options: tuple[str, ...] = ()
    is_tested: bool = True
    """Ask for a fingerprint: some recordings of the second plant take it ten minutes."""


def asked(arguments: Sequence[str | Path], said: Path) -> None:
    """Run a command of the project; keep what it prints, and its exit status, in a file."""
    command = [sys.executable, "-m", "edge_service", *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    beside = re.sub(r"(?m)^edge-service [a-z-]+: .+ \d+ s\n", "", done.stderr)  # progress
    said.write_text(f"{done.stdout}{beside}exit {done.returncode}\n", "utf-8")


def make_recordings(folder: Path) -> None:
    """Recordings of the simulated bench and of the foreign plant."""
    for number, cause in enumerate(CAUSES):
        for motion in MOTIONS:
            name = f"{number}_{motion.split(':')[0]}"
            effect = ["--effect", cause] if cause else []
            out = folder / "own" / f"{name}.csv"
            out.parent.mkdir(parents=True, exist_ok=True)
            asked(
                ["simulate", "--motion", motion, *effect, "--seed", "5", "--out", out],
                folder / f"{name}.txt",
            )
    foreign = folder / "foreign"
    foreign.mkdir()
    text = foreign_plant.nominal_machine_toml(foreign_plant.DIAGNOSIS)
    (foreign / "machine.toml").write_text(text, "utf-8")
    for cause in ("", "torque_ripple", "backlash"):
        effects = ((cause, 1.0),) if cause else ()
        made = foreign_plant.simulate(
            foreign_plant.case(effects, "production", seed=5, duration_s=60.0)
        )
        written(foreign / f"{cause or 'healthy'}.csv", made.columns)


def make_real(folder: Path) -> None:
    """Traces of the real machines that lie beside the checkout."""
    folder.mkdir()
    (folder / "actuator.toml").write_text(ACTUATOR_TOML, "utf-8")
    (folder / "screw.toml").write_text(SCREW_TOML, "utf-8")
    for condition in ("normal", "lackLubrication1", "backlash1"):
        home = folder / condition
        home.mkdir()
        recordings(home, condition, "40")
    for number, name in enumerate(("no-load-square-wave-full-travel", "pp-sine-sweep-10mm")):
        screw_actuator(folder / f"screw{number}.csv", f"LinA_{name}-0.5Hz")
    milling_machine(folder / "milling.csv")


def recorded(folder: Path) -> Iterator[Recorded]:
    """All recordings, each with its machine file."""
    for path in sorted((folder / "own").glob("*.csv")):
        yield Recorded(f"own_{path.stem}", ROOT / "deploy" / "machine.toml", (path,))
    for path in sorted((folder / "foreign").glob("*.csv")):
        yield Recorded(f"foreign_{path.stem}", folder / "foreign" / "machine.toml", (path,))
    for case in sorted(folder.glob("second/case-*"))[:SECOND]:
        traces = tuple(sorted((case / "traces").glob("*.csv")))
        first = case.name == "case-000"
        yield Recorded(f"second_{case.name}", case / "machine.toml", traces, is_tested=first)
    emps = BESIDE / "data" / "emps" / "emps_estimation.csv"
    if emps.is_file():
        yield Recorded("emps", ROOT / "deploy" / "emps.toml", (emps,))
    yield from really_recorded(folder / "real")


def really_recorded(folder: Path) -> Iterator[Recorded]:
    """Recordings of real machines, each with its machine file; none where there are none."""
    for home in sorted(each for each in folder.glob("*") if each.is_dir()):
        traces = tuple(sorted(home.glob("*.csv")))[:2]
        yield Recorded(f"real_{home.name}", folder / "actuator.toml", traces)
    for path in sorted(folder.glob("screw*.csv")):
        yield Recorded(f"real_{path.stem}", folder / "screw.toml", (path,))
    milling = folder / "milling.csv"
    if milling.is_file():
        number = ("--axis-number", "1")
        yield Recorded("real_milling", folder / "actuator.toml", (milling,), number)
        yield Recorded("real_no_number", folder / "actuator.toml", (milling,))
    mill = BESIDE / "data" / "smart_cnc_mill" / "experiment_06.csv"
    if mill.is_file():
        yield Recorded("real_slow_mill", ROOT / "deploy" / "cnc_mill.toml", (mill,))


def ask_all(folder: Path, answers: Path, only: Sequence[str] = ()) -> None:
    """Ask every command of every recording, or of some; paths of this checkout are left out."""
    answers.mkdir(parents=True)
    for each in recorded(folder):
        if not only or each.name in only:
            ask_recording(each, answers / each.name)
    if not only:
        ask_models(answers)
    for path in answers.rglob("*.txt"):
        said = path.read_text("utf-8").replace(str(answers), "ANSWERS")
        path.write_text(said.replace(str(ROOT), "ROOT"), "utf-8")


def ask_recording(each: Recorded, home: Path) -> None:
    """Ask every command that reads a recording."""
    home.mkdir()
    model: list[str | Path] = ["--machine", each.machine, *each.options]
    asked(["gap", *model, *each.traces, "--json"], home / "gap.txt")
    asked(["doctor", *model, *each.traces, "--json"], home / "doctor.txt")
    asked(["diagnose", *model, *each.traces, "--out", home / "diagnosis"], home / "said.txt")
    if each.is_tested:
        asked(["fingerprint", *model, each.traces[0], "--out", home / "print"], home / "print.txt")
    out, state = home / "estimates.csv", home / "state.json"
    estimated: list[str | Path] = ["estimate", *model, each.traces[0], "--out", out]
    asked(estimated, home / "estimate.txt")
    learnt = home / "commissioned.toml"
    asked(["commission", *model, each.traces[0], "--out", learnt], home / "commission.txt")
    if learnt.is_file():
        known: list[str | Path] = ["--machine", learnt, *each.options, "--state", state]
        out = home / "known.csv"
        asked(["estimate", *known, each.traces[-1], "--out", out], home / "known.txt")


def ask_models(answers: Path) -> None:
    """Ask what needs no recording: configurations, motions, the thesis."""
    deploy = ROOT / "deploy"
    for path in (deploy / "edge.toml", *sorted((deploy / "drivers").glob("*.toml"))):
        asked(["check-config", path], answers / f"config_{path.stem}.txt")
    asked(["motion"], answers / "motions.txt")
    asked(
        ["motion", "friction", "--out", answers / "friction.csv", "--rate", "100"],
        answers / "motion.txt",
    )
    asked(["motion", "isolability", "friction"], answers / "isolability.txt")
    asked(["reproduce", "--out", answers / "thesis"], answers / "thesis.txt")


def differing(before: Path, after: Path, only: Sequence[str] = ()) -> list[str]:
    """Names of answers that differ, or are there once only."""
    names = {
        path.relative_to(root)
        for root in (before, after)
        for path in root.rglob("*")
        if path.suffix in COMPARED and (not only or path.relative_to(root).parts[0] in only)
    }
    return [
        str(name)
        for name in sorted(names)
        if not ((before / name).is_file() and (after / name).is_file())
        or not filecmp.cmp(before / name, after / name, shallow=False)
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Record, or check."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("record", "check"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", default=(), help="names of recordings")
    given = parser.parse_args(arguments)
    folder = given.folder.resolve()
    if given.what == "record":
        folder.mkdir(parents=True)
        make_recordings(folder)
        second = BESIDE / "bench" / "make.py"
        if second.is_file():
            made = [sys.executable, str(second), str(folder / "second"), "--seed", "5"]
            subprocess.run([*made, "--set", "small"], check=True, capture_output=True)
        if (BESIDE / "data").is_dir():
            make_real(folder / "real")
        ask_all(folder, folder / "answers")
        return 0
    with tempfile.TemporaryDirectory(prefix="same-answers-") as home:
        ask_all(folder, Path(home) / "answers", given.only)
        found = differing(folder / "answers", Path(home) / "answers", given.only)
        for name in found:
            sys.stdout.write(f"{name}\n")
            kept = folder / "differing" / name
            kept.parent.mkdir(parents=True, exist_ok=True)
            if (Path(home) / "answers" / name).is_file():
                shutil.copy(Path(home) / "answers" / name, kept)
    sys.stdout.write(f"{len(found)} answers differ\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
