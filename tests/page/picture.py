"""Picture of the page of a machine of eight axes, two of them worn out, for the documents."""

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from ..bench.speed.process_meter import ServiceProcess
from .conftest import CHROMIUM

_PATIENCE_S = 120.0
_SETTLED_MS = 15_000
_HEAD = """\
[bus]
endpoint = "tcp/127.0.0.1:0"
[http]
port = 0
[store]
folder = "history"
"""
_AXIS = """
[[axes]]
name = "{name}"
driver = "simulated"
[axes.settings]
scenario = "{scenario}"
life_s = 20.0
hold_s = 20.0
"""
_WORN = "YC"


def draw(out: Path) -> None:
    """Write the picture, once both worn axes are in FAULT."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        axes = [
            _AXIS.format(name=each, scenario="sudden" if each in _WORN else "healthy")
            for each in "XYZABCUV"
        ]
        (folder / "edge.toml").write_text(_HEAD + "".join(axes), "utf-8")
        with (
            ServiceProcess(["run", "edge.toml"], folder, folder / "kernels") as service,
            sync_playwright() as playwright,
        ):
            host, port = service.wait_for_address(_PATIENCE_S)
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1440, "height": 1060})
            page.goto(f"http://{host}:{port}/")
            page.wait_for_selector(
                "#machine-answer:has-text('Y (FAULT) and C (FAULT)')", timeout=1000 * _PATIENCE_S
            )
            page.wait_for_timeout(_SETTLED_MS)
            page.screenshot(path=out)
            browser.close()


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
