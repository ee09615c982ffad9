#!/bin/sh
# Everything that must hold: formatting, lint, types, the rules of the house, all tests.
# `deploy/check.sh fast` leaves the slow tests out.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh
bin=.venv/bin
step() { echo "check: $*" >&2; "$@"; }

step $bin/ruff format --check --quiet .
step $bin/ruff check --quiet .
step $bin/mypy --no-error-summary
step $bin/lint-imports --no-logo
if [ "${1:-all}" = fast ]; then
  step $bin/python -m pytest -q -m "not slow"
else
  step $bin/python -m pytest -q
fi
echo "check: all good" >&2
