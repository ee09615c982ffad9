"""The page prints a value and its bounds as letters and commands do."""

import json
import random
import shutil
import subprocess
from pathlib import Path

import pytest

from edge_service.messages.interval import printed

FORMAT = Path(__file__).parents[2] / "edge_service" / "http_api" / "static" / "format.js"
NODE = shutil.which("node")


def cases() -> list[tuple[float, float, float]]:
    """Values with bounds from wide to so narrow that whole percents would hide them."""
    chance = random.Random(1)
    found = [(103.6, 97.2, 103.9), (104.2, 97.0, 104.2), (0.0, 0.0, 12.3)]
    for _ in range(500):
        value, reach = chance.uniform(0.1, 130.0), 10.0 ** chance.uniform(-3.0, 1.5)
        found.append((value, max(value - reach, 0.0), value + chance.random() * reach))
    return found


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_page_and_letters_print_alike(tmp_path: Path) -> None:
    assert NODE is not None
    (tmp_path / "strings.js").write_text(
        "export const locale = 'en-GB', counted = () => '';\n"
        "export const t = (_key, { low, high }) => `${low} ${high}`;\n"
    )
    (tmp_path / "format.js").write_text(FORMAT.read_text("utf-8"), "utf-8")
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "run.js").write_text(
        "import { printed } from './format.js';\n"
        f"const cases = {json.dumps(cases())};\n"
        "const told = cases.map(([value, low, high]) => printed({ value, low, high }));\n"
        "console.log(JSON.stringify(told.map(({ value, bounds }) => `${value} ${bounds}`)));\n"
    )
    done = subprocess.run(
        [NODE, "run.js"], cwd=tmp_path, check=True, capture_output=True, timeout=60
    )
    assert json.loads(done.stdout) == [" ".join(printed(*each)) for each in cases()]
