#!/bin/sh
# Everything that must hold: formatting, lint, types, the rules of the house, all tests.
# `deploy/check.sh fast` leaves the slow tests out.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh
bin=.venv/bin

# The page is tested in a real browser. Without one, and without the right to install it, those
# tests are skipped.
$bin/python -m pip install --quiet --disable-pip-version-check --require-hashes \
  -r deploy/requirements-browser.lock
if ! command -v chromium >/dev/null 2>&1 && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
  echo "check: installing Debian's chromium" >&2
  (apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core prometheus) \
    >/dev/null 2>&1 || echo "check: chromium cannot be installed, the browser tests are skipped" >&2
fi

# A reader of Sparkplug that nobody here wrote. It asks for paho-mqtt 1, but its codec needs none.
$bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes \
  -r deploy/requirements-sparkplug.lock

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
