#!/bin/sh
# Sets up .venv at the project's root with the locked versions and installs the project into it.
# Needs Python 3.11 or newer with pip. Safe to run again: does nothing if all is as it should be.
# `deploy/setup.sh dev` adds what tests and checks need, and leaves compiling to `deploy/setup.sh kernels`.
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
locks="-r deploy/requirements.lock"
purpose=run
if [ "${1:-run}" = dev ]; then
  locks="$locks -r deploy/requirements-dev.lock -r deploy/requirements-package.lock"
  purpose=dev
fi
stamp=.venv/.installed
wanted=$(cat deploy/requirements.lock deploy/requirements-dev.lock deploy/requirements-package.lock \
  pyproject.toml | cksum)

is_there() { # what is set up for development serves for running too
  [ -x .venv/bin/edge-service ] || return 1
  case "$(cat "$stamp" 2>/dev/null)" in "$purpose $wanted" | "dev $wanted") ;; *) return 1 ;; esac
}

size_mb() { du -sm .venv | cut -f1; }

count_packages() { echo "$locks" | tr ' ' '\n' | grep lock | xargs cat | grep -c '^[a-z].*=='; }

step() { echo "setup: [$1] $2" >&2; }

compile_kernels() { # on two cores: the filter's step and the simulated drive beside all else; bytecode
  unset PYTHONDONTWRITEBYTECODE # else each start of the service compiles all of its modules
  trial=$(mktemp -d)
  mixture='from pathlib import Path
from edge_service.config import EstimatorConfig, load_machine
from edge_service.estimate.mixture import hypotheses, model, posterior, state, step
from edge_service.nodes.stages import warm_up
machines = [load_machine(Path(f"deploy/{name}.toml")) for name in ("machine", "commissioned")]
axis, assumed = model.axis_model(machines[1]), state.ASSUMED
start = model.start_of(machines[1], axis, assumed)
bank = hypotheses.initial_bank(start, assumed)'
  {
    .venv/bin/python -c "$mixture
reading = state.Reading(0.1, 1.0, 0.1, 0.0, 10.0, 0.1, 0.0)
step.step(bank, axis, model.process_of(machines[1], axis, start, assumed), reading, 0.1)"
    .venv/bin/edge-service simulate --duration 0.1 --out "$trial/trace.csv" >/dev/null
  } &
  beside=$!
  .venv/bin/python -c "$mixture
posterior.posterior_of(bank, axis, posterior.fault_limits(machines[1], axis, assumed))
warm_up(EstimatorConfig(), machines[:1])"
  wait $beside
  .venv/bin/python -c "$mixture
import edge_service.nodes.service
for engine in (\"compiled\", \"filterpy\"):
    warm_up(EstimatorConfig(engine=engine), machines)"
  .venv/bin/edge-service check-config deploy/edge.toml >/dev/null
  rm -r "$trial"
}

if [ "${1:-}" = kernels ]; then
  compile_kernels
elif ! is_there; then
  began=$(date +%s)
  step 1/3 "$("$python" --version) into .venv"
  make_venv "$python"
  step 2/3 "$(count_packages) locked packages, once; a minute or two, by the network"
  # shellcheck disable=SC2086  # several words
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile \
    --require-hashes $locks
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
  [ $purpose = dev ] || {
    sh deploy/slim.sh .venv
    step 3/3 "compiling the numeric kernels, once; a minute or two ($(size_mb) MB so far)"
    compile_kernels
  }
  echo "$purpose $wanted" >"$stamp"
  echo "setup: done: $(size_mb) MB in .venv, $(($(date +%s) - began)) s" >&2
fi
