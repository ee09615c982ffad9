"""`edge-service update`: a machine file with what an axis has become since, and no fault in it."""

import math
import re
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tomlkit

from ..atomic import write_whole
from ..command_answer import Answer
from ..config import ConfigError, load_machine
from ..diagnose.result import Diagnosis, NamedEffect
from ..diagnose.session.session import CHANNEL_UNITS, TORQUE_GAP
from ..exit_status import DONE
from ..models.effects.effect import Role, Term
from ..models.effects.registry import get_effect
from ..models.machine import Machine
from ..recordings.writer import write_parts
from .diagnosis.diagnose import augmented_toml, diagnose
from .diagnosis.gap import BadDataError, gap
from .doctor import DOUBTED
from .recordings import open_recording, reported
from .report.diagnosis_page import points, sure
from .report.quantities import amount

BLOCK_S, PARTS = 15.0, 3
"""Length of a block of a recording, s; of so many one is held out."""
_DATE = re.compile(r"-\d{4}-\d\d-\d\d$")


def update(
    machine_file: Path, traces: Sequence[Path], out: Path | None, axis_number: int | None = None
) -> Answer:
    """Write a dated copy of the machine file with what has changed, where that helps.

    What may be a lost preload is never adopted: then nothing is written, and the status says so.

    Raises ConfigError, TraceError, DiagnosisError, BadDataError.
    """
    machine, text = load_machine(machine_file, axis_number), machine_file.read_text("utf-8-sig")
    now, names = datetime.now(UTC), ", ".join(trace.name for trace in traces)
    today = f"{_DATE.sub('', machine_file.stem)}-{now:%Y-%m-%d}{machine_file.suffix}"
    place = out or machine_file.with_name(today)
    if place.exists():
        raise ConfigError(f"--out {place}: is there already; an update overwrites nothing")
    with tempfile.TemporaryDirectory(prefix="edge-update-") as folder:
        found, old, new = _examined(machine, text, traces, Path(folder))
    adopted = [each for each in found.effects if each.name in found.augmented]
    is_blind = TORQUE_GAP not in old
    hiding = [each.name for each in adopted if is_blind or _rubs_less(each)]
    told = ((old[n], new[n], each.tolerance or 0.0) for n, each in found.gap.items() if n in old)
    is_harmed = any(after > math.hypot(before, tolerated) for before, after, tolerated in told)
    withheld, refused = [*found.withheld, *hiding], ""
    if withheld:
        refused = f"{', '.join(withheld)}: a lost preload, or perhaps one; a model learns no fault"
    elif not adopted:
        refused = "no change is beyond doubt"
    elif is_harmed or any(old.get(e.channel, 0.0) <= new.get(e.channel, 0.0) for e in adopted):
        refused = "it does not help on the blocks that were held out"
    kept = [each for each in adopted if each.name not in hiding]
    changes = [change for each in kept for change in _changes(machine, each)]
    lines = [f"{each['parameter']}: {each['words']}; {each['why']}" for each in changes]
    for channel in old:
        was, left = (amount(each[channel], CHANNEL_UNITS[channel]) for each in (old, new))
        lines.append(f"{channel}: {was} before, {left} after, on the blocks that were held out")
    lines += [f"but {each}" for each in found.caveats]
    verdict = f"nothing is written: {refused}"
    if not refused:
        head = f"# Made by `edge-service update` at {now:%Y-%m-%dT%H:%MZ} from {names}.\n"
        write_whole(place, head + augmented_toml(text, adopted))
        verdict = f"{place}: written; name it as `machine` of the axis, then reload the service"
    document: dict[str, Any] = {"out": None if refused else str(place), "refused": refused or None}
    document |= {"verdict": verdict, "changes": changes, "withheld": withheld}
    document["gap"] = {"before": old, "after": new}
    return Answer("\n".join([*lines, verdict]), document, DOUBTED if withheld else DONE)


def _examined(
    machine: Machine, text: str, traces: Sequence[Path], folder: Path
) -> tuple[Diagnosis, dict[str, float], dict[str, float]]:
    """Diagnosis of two of three blocks; gap of the third, without and with what it has found."""
    learned, held_out = list[Path](), list[Path]()
    for number, trace in enumerate(traces):
        with open_recording(machine, trace) as reader:
            frames = reported(reader, f"reading {trace.name}")
            paths = [folder / f"{trace.stem}_{number}_{kind}.parquet" for kind in ("of", "out")]
            is_long = write_parts(frames, reader.channels, paths, BLOCK_S, PARTS)
        learned.append(paths[0])
        held_out += paths[1:] if is_long else []
    if not held_out:
        raise ConfigError(f"{traces[0]}: too short; expected {PARTS * BLOCK_S:g} s or more")
    plain = tomlkit.parse(text)
    plain.pop("columns", None)  # the parts hold channels
    before, after = folder / "before.toml", folder / "out" / "augmented.toml"
    write_whole(before, tomlkit.dumps(plain))
    try:
        found: Diagnosis = diagnose(before, learned, after.parent).document
    except BadDataError as error:
        raise BadDataError(str(error).partition(" (report")[0]) from None
    return found, gap(before, held_out).document, gap(after, held_out).document


def _rubs_less(each: NamedEffect) -> bool:
    """Flag of less dry friction, which is what a lost preload looks like."""
    changes = (value for entry in each.entries for value in entry.values())
    return get_effect(each.name).term is Term.COULOMB and any(value < 0.0 for value in changes)


def _changes(machine: Machine, each: NamedEffect) -> list[dict[str, Any]]:
    """Parameters of an effect that is adopted: old, new with its interval, and why."""
    stated = [entry.parameters for entry in machine.effects if entry.name == each.name]
    amounts = {p.name for p in get_effect(each.name).parameters if p.role is Role.AMOUNT}
    why = f"{sure(each.probability)}, and no lost preload; "
    why += f"less {each.channel} by {points(each.shrink)}"
    found = []
    for name, value in each.parameters.items():
        old = sum(entry[name].value for entry in stated if name in entry and name in amounts)
        low, high = (None if end is None else old + end for end in (value.low, value.high))
        told = dict[str, Any](parameter=f"{each.name}.{name}", old=old, new=old + value.value)
        ends = " to ".join("open" if end is None else f"{end:.3g}" for end in (low, high))
        words = f"{old:.3g} -> {old + value.value:.3g} {value.unit} ({ends})"
        found.append(
            told | {"low": low, "high": high, "unit": value.unit, "words": words, "why": why}
        )
    return found
