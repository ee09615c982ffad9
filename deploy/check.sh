#!/bin/sh
# Everything that must hold: formatting, lint, types, the rules of the house, all tests.
# `deploy/check.sh fast` leaves the slow tests out.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh
bin=.venv/bin
step() { echo "check: $*" >&2; "$@"; }

# A device and a broker that nobody here wrote: without them those tests are skipped and say so.
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null &&
  { [ ! -e /usr/include/modbus/modbus.h ] || [ ! -x /usr/sbin/mosquitto ]; }; then
  echo "check: installing libmodbus and mosquitto for the tests" >&2
  { apt-get update -qq && RUNLEVEL=1 DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
    gcc libc6-dev libmodbus-dev mosquitto; } >/dev/null 2>&1 ||
    echo "check: they cannot be installed; their tests are skipped" >&2
fi

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
