#!/bin/sh
# Sets up .venv at the project's root with the locked versions and installs the project into it.
# Needs Python 3.11 or newer with pip. Safe to run again: does nothing if all is as it should be.
set -eu
cd "$(dirname "$0")/.."

fail() { echo "setup: $1" >&2; exit 2; }

find_python() {
  for candidate in python3.11 python3.12 python3.13 python3 python; do
    if command -v "$candidate" >/dev/null 2>&1 &&
      "$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; then
      command -v "$candidate"
      return
    fi
  done
  return 1
}

make_venv() { # Debian's python3 lacks ensurepip; virtualenv from pip stands in
  "$1" -m venv --clear .venv >/dev/null 2>&1 && return
  rm -rf .venv
  "$1" -m pip --version >/dev/null 2>&1 || fail "$1 has neither venv nor pip"
  tool=$(mktemp -d)
  "$1" -m pip install --quiet --disable-pip-version-check --target "$tool" virtualenv
  PYTHONPATH="$tool" "$1" -m virtualenv --quiet .venv
  rm -rf "$tool"
}

python=$(find_python) || fail "no Python 3.11 to 3.13 found"
stamp=.venv/.installed
wanted=$(cat deploy/requirements.lock pyproject.toml | cksum)
if [ "$(cat "$stamp" 2>/dev/null || true)" != "$wanted" ] || [ ! -x .venv/bin/edge-service ]; then
  echo "setup: installing the locked packages into .venv" >&2
  make_venv "$python"
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r deploy/requirements.lock
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
  echo "setup: compiling the numeric kernels" >&2
  .venv/bin/python -c 'from pathlib import Path
from edge_service.config import load_machine
from edge_service.nodes.wiring.stages import warm_up
warm_up()
warm_up(machines=[load_machine(Path("deploy/commissioned.toml"))])'
  echo "$wanted" >"$stamp"
fi
