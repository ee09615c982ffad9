"""A service without machine code has it compiled by a process that ends."""

import os
import subprocess
import sys
from pathlib import Path

SERVICE = """
from numba.core.event import install_recorder
from edge_service.models.screw.nut_law import nut_stiffness
from edge_service.nodes.wiring import kernels
kernels.compile_in_another_process()
{before}
with install_recorder("numba:compile") as recorder:
    print(nut_stiffness(1.6e8, 10.0) == nut_stiffness.py_func(1.6e8, 10.0))
print(len(recorder.buffer))
kernels.REST_S = -1.0
kernels.COMPILER.rest()
print(kernels.COMPILER._process)
"""
BROKEN = "kernels._COMMAND = ('/bin/false',)"


def told(folder: Path, before: str) -> list[str]:
    run = subprocess.run(
        [sys.executable, "-c", SERVICE.format(before=before)],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.split()


def test_a_service_compiles_nothing_itself(tmp_path: Path) -> None:
    assert told(tmp_path, "") == ["True", "0", "None"]


def test_where_no_other_process_can_it_does(tmp_path: Path) -> None:
    right, compilations, process = told(tmp_path, BROKEN)
    assert (right, process) == ("True", "None")
    assert int(compilations) > 0
