"""Changes a copy of a folder by a command that is killed at each of its steps in turn.

`python rollout_killed.py FOLDER OUT COMMAND...`: copies FOLDER to OUT/1, OUT/2, ..., gives the
command that copy in place of `{place}`, and kills it before its first, second, ... change of a file
in there. Prints in how many copies it was killed; in the one after those it came to its end.
"""

import contextlib
import io
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

from edge_service.cli.entry import main

_CHANGES = {"os.rename", "os.symlink", "os.mkdir", "os.remove", "os.rmdir", "os.chmod", "os.chown"}


def kill_at(step: int, place: Path) -> None:
    """Kill this process when it is about to change a file in a folder for the `step`th time."""
    left = step

    def count(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal left
        writes = event == "open" and isinstance(arguments[2], int) and arguments[2] & os.O_ACCMODE
        if event not in _CHANGES and not writes:
            return
        if any(str(each).startswith(str(place)) for each in arguments[:2]):
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)


def was_killed(step: int, place: Path, command: list[str]) -> bool:
    child = os.fork()
    if child == 0:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        kill_at(step, place)
        os._exit(main([each.replace("{place}", str(place)) for each in command]))
    _, status = os.waitpid(child, 0)
    if not os.WIFSIGNALED(status) and os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(f"step {step}: exit status {os.waitstatus_to_exitcode(status)}")
    return os.WIFSIGNALED(status)


def run(folder: Path, out: Path, command: list[str]) -> int:
    shutil.copytree(folder, out / "0", symlinks=True)
    with contextlib.redirect_stdout(io.StringIO()):  # once in this process: it loads all modules
        main([each.replace("{place}", str(out / "0")) for each in command])
    step = 0
    while True:
        step += 1
        place = out / str(step)
        shutil.copytree(folder, place, symlinks=True)
        if not was_killed(step, place, command):
            return step - 1


if __name__ == "__main__":
    sys.stdout.write(str(run(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])))
