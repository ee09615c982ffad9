"""No part of the program loads what an installation leaves out of its packages."""

import shutil
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.documents import ROOT
from tests.programs import printed

RUN = """
import pkgutil, sys
from importlib import import_module
from pathlib import Path
import drivers, edge_service

for package in (edge_service, drivers):
    for each in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not each.name.endswith("__main__"):
            import_module(each.name)

from edge_service.cli.entry import main

motion = ["simulate", "--motion", "production", "--duration", "5"]
assert main([*motion, "--out", "trace.parquet"]) == 0
assert main(["convert", "trace.parquet", "--out", "trace.csv"]) == 0
assert main(["convert", "trace.csv", "--out", "again.parquet"]) == 0
assert main(["adopt", "trace.csv", "--out", "m.toml", "--plot", "channels.png"]) == 0
assert main(["estimate", "trace.csv", "--out", "estimates.csv"]) == 0
for module in list(sys.modules.values()):
    print(getattr(module, "__file__", None) or "")
print(Path("/proc/self/maps").read_text())
"""


@pytest.mark.slow
def test_nothing_that_is_loaded_is_left_out(tmp_path: Path) -> None:
    packages = Path(sysconfig.get_path("purelib"))
    unused = printed("sh", ROOT / "deploy" / "unused.sh", packages.parents[2]).splitlines()
    assert all(Path(path).exists() for path in unused)
    assert sum(path.endswith("/tests") for path in unused) > 5
    # Arrow looks for each of its parts and does without: here it runs as it is installed.
    arrow = tmp_path / "packages" / "pyarrow"
    left_out = [Path(path).name for path in unused if Path(path).parent == packages / "pyarrow"]
    assert "libarrow_python.so" in left_out
    shutil.copytree(packages / "pyarrow", arrow, ignore=lambda *_: left_out, symlinks=True)
    (library,) = arrow.glob("libparquet.so.*")
    whole = library.stat().st_size
    printed(sys.executable, ROOT / "deploy" / "strip.py", arrow)
    assert library.stat().st_size < 0.9 * whole
    told = printed(sys.executable, "-c", RUN, folder=tmp_path, PYTHONPATH=str(arrow.parent))
    assert f"{arrow}/libarrow.so" in told
    loaded = {f"{line.split()[-1]}/" for line in told.splitlines() if line}
    assert [path for path in unused if any(each.startswith(f"{path}/") for each in loaded)] == []
