"""Traces and machine files from their recipes; the same recipe is made once."""

import csv
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from edge_service.cli.entry import main

from .. import foreign_plant
from ..bench.real_machines import ACTUATOR_TOML, DATA, SCREW_TOML, recordings
from ..foreign_plant import motions
from .case_file import Case, Foreign, Real, Trace
from .edits import Columns, edited

Maker = Callable[[Path], object]
DEPLOY = Path(__file__).parents[2] / "deploy"
MACHINES = {
    "foreign": foreign_plant.nominal_machine_toml(foreign_plant.Machine()),
    "foreign_diagnosis": foreign_plant.nominal_machine_toml(foreign_plant.DIAGNOSIS),
    "actuator": ACTUATOR_TOML,
    "screw_actuator": SCREW_TOML,
}


class RecipeError(Exception):
    """A recipe makes nothing: the case is wrong, not the answer."""


class RecordingsAbsentError(Exception):
    """Real recordings are not beside the checkout."""


class Store:
    """Files made from recipes, below one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def machine(self, case: Case, home: Path) -> Path:
        """Machine file of a case whose folder is `home`, learned first if the case says so."""
        own, shipped = home / "machine.toml", DEPLOY / f"{case.machine}.toml"
        text = own.read_text() if own.exists() else MACHINES.get(case.machine)
        text = shipped.read_text() if text is None else text
        if not case.commission:
            return self._kept(text, "machine.toml", lambda path: path.write_text(text))
        traces = [str(path) for name in case.commission for path in self.trace(case.traces[name])]
        nominal = self._kept(text, "machine.toml", lambda path: path.write_text(text))

        def learn(path: Path) -> None:
            command = ["commission", "--machine", str(nominal), *traces, "--out", str(path)]
            _made_with([*command, "--assume-fresh"])  # the recipe says that they are healthy

        return self._kept(f"{text}{traces}", "commissioned.toml", learn)

    def trace(self, recipe: Trace) -> list[Path]:
        """Files of one recipe; several only of a real recording in parts."""
        if recipe.real and recipe.real.condition:
            return self._cranfield(recipe.real)
        return [self._kept(repr(recipe), recipe.name, lambda path: self._make(recipe, path))]

    def _kept(self, key: str, name: str, make: Maker) -> Path:
        path = self.folder / sha256(key.encode()).hexdigest()[:16] / name
        if not path.parent.exists():
            path.parent.mkdir()
            try:
                make(path)
            except BaseException:
                shutil.rmtree(path.parent)
                raise
        return path

    def _make(self, recipe: Trace, path: Path) -> None:
        if recipe.folder:
            path.mkdir()
        elif recipe.text is not None:
            path.write_text(recipe.text)
        elif recipe.hexadecimal is not None:
            path.write_bytes(bytes.fromhex(recipe.hexadecimal))
        else:
            columns = self._columns(recipe)
            for edit in recipe.edits:
                columns = edited(columns, edit)
            written(path, columns, recipe.nan)
        for expression, text in recipe.replace.items():
            path.write_text(re.sub(expression, text, path.read_text(), flags=re.MULTILINE))
        if recipe.torn < 1.0:
            content = path.read_bytes()
            path.write_bytes(content[: int(recipe.torn * len(content))])

    def _columns(self, recipe: Trace) -> Columns:
        if recipe.real is not None:
            return real(recipe.real)
        if recipe.simulate is not None:
            return read(self._kept(recipe.simulate, "own.parquet", simulation(recipe.simulate)))
        assert recipe.foreign is not None
        made = recipe.foreign
        return read(self._kept(repr(made), "foreign.parquet", second_plant(made)))

    def _cranfield(self, recipe: Real) -> list[Path]:
        needs(DATA / "cranfield")
        condition, load = str(recipe.condition), str(recipe.load_kgf)

        def make(path: Path) -> None:
            path.mkdir()
            recordings(path, condition, load)

        folder = self._kept(f"cranfield {condition} {load}", "sequences", make)
        paths = sorted(folder.iterdir(), key=lambda each: int(each.stem.removeprefix(condition)))
        return [paths[part] for part in recipe.parts]


def _made_with(command: list[str]) -> None:
    if main(command) != 0:
        raise RecipeError(f"{' '.join(command)} did not end with 0")


def simulation(arguments: str) -> Maker:
    """Maker of what `edge-service simulate` records; `{deploy}` holds machine files."""

    def make(path: Path) -> None:
        _made_with(["simulate", *arguments.format(deploy=DEPLOY).split(), "--out", str(path)])

    return make


def second_plant(recipe: Foreign) -> Maker:
    return lambda path: written(path, foreign_plant.simulate(foreign_case(recipe)).columns)


def foreign_case(recipe: Foreign) -> Any:
    arguments = dict(recipe.arguments)
    if recipe.events:
        arguments["events"] = tuple(_event(each) for each in recipe.events)
    if recipe.preload is not None:
        arguments["preload"] = recipe.preload
    if recipe.motion:
        arguments["setpoint_m"] = _setpoint(recipe.motion, int(arguments.get("seed", 0)))
    if recipe.effects:
        arguments["effects"] = tuple(recipe.effects.items())
    return getattr(foreign_plant, recipe.case)(**arguments)


def _event(given: Mapping[str, Any]) -> Any:
    """Event by its `name`, its other members as arguments; lists as tuples."""
    members = {key: _tuples(value) for key, value in given.items() if key != "name"}
    return getattr(foreign_plant, given["name"])(**members)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(each) for each in value) if isinstance(value, list) else value


def _setpoint(parts: Sequence[tuple[str, float]], seed: int) -> Any:
    """Setpoints at 1 kHz, (n,) m: each part goes on where the last one ended."""
    rng = np.random.default_rng([seed, 1])
    path = np.empty(0)
    for name, duration_s in parts:
        at_m = float(path[-1]) if len(path) else 0.4
        if name == "production":
            made = motions.production(rng, duration_s)
            if len(path):
                made = np.concatenate([motions.Route(at_m).to(made[0], 0.3).positions(), made])
        else:
            still = motions.standstill(duration_s, at_m)
            made = still if name == "standstill" else motions.jogs(rng, duration_s, at_m)
        path = np.concatenate([path, made])
    return path


def real(recipe: Real) -> Columns:
    needs(DATA / recipe.file)
    with (DATA / recipe.file).open() as file:
        rows = csv.reader(file)
        header = next(rows)
        table = np.array([[float(cell or "nan") for cell in row] for row in rows]).T
    columns = dict(zip(header, table, strict=True))
    if recipe.every_s is not None:
        columns = {"time_s": recipe.every_s * np.arange(table.shape[1])} | columns
    return columns


def needs(path: Path) -> None:
    if not path.exists():
        raise RecordingsAbsentError(f"{path.relative_to(DATA.parents[1])} is not here")


def read(path: Path) -> Columns:
    """Columns of a Parquet file, each (n,)."""
    table = pyarrow.parquet.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}


def written(path: Path, columns: Columns, nan: bool = False) -> None:
    """Write columns as CSV or Parquet; a value that is missing is an empty cell, or `nan`."""
    cells = {name: pa.array(x, mask=None if nan else np.isnan(x)) for name, x in columns.items()}
    table = pa.table(cells)
    if path.suffix == ".parquet":
        pyarrow.parquet.write_table(table, path)
    else:
        pyarrow.csv.write_csv(table, path)
