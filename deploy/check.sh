#!/bin/sh
# Everything that must hold: formatting, lint, types, the rules of the house, all tests.
# `deploy/check.sh fast` leaves the slow tests out.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh dev
bin=.venv/bin

# What the tests use besides: a browser for the page, a Prometheus that scrapes, a Modbus device and
# an MQTT broker that nobody here wrote, what looks at the Debian package, two reverse proxies. Without
# them, and without the right to install them, their tests are skipped and say so.
complete() {
  for tool in chromium prometheus gcc lintian; do command -v "$tool" >/dev/null 2>&1 || return 1; done
  [ -e /usr/include/modbus/modbus.h ] && [ -x /usr/sbin/mosquitto ] &&
    [ -x /usr/sbin/nginx ] && [ -x /usr/bin/caddy ]
}
if ! complete && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
  echo "check: installing chromium, prometheus, libmodbus, mosquitto, lintian, nginx and caddy for the tests" >&2
  { apt-get update -qq && RUNLEVEL=1 DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
    --no-install-recommends chromium fonts-dejavu-core prometheus gcc libc6-dev libmodbus-dev \
    mosquitto lintian python3-venv nginx-light caddy curl; } >/dev/null 2>&1 ||
    echo "check: they cannot all be installed; the tests of what is missing are skipped" >&2
fi

$bin/python -m pip install --quiet --disable-pip-version-check --require-hashes \
  -r deploy/requirements-browser.lock
# A reader of Sparkplug that nobody here wrote. It asks for paho-mqtt 1, but its codec needs none.
$bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes \
  -r deploy/requirements-sparkplug.lock

# A tester of the interface by its schema, that nobody here wrote. Its test is not skipped here.
$bin/python -m pip install --quiet --disable-pip-version-check --require-hashes \
  -r deploy/requirements-schema.lock
export EDGE_SERVICE_CHECK=1

# The builder of the Debian package, and the linter of the Containerfile.
$bin/python -m pip install --quiet --disable-pip-version-check --require-hashes \
  -r deploy/requirements-package.lock

step() { echo "check: $*" >&2; "$@"; }

step $bin/ruff format --check --quiet .
step $bin/ruff check --quiet .
step $bin/mypy --no-error-summary
step $bin/lint-imports --no-logo
# A process per core: no test shares a port, a cache or a folder with another.
parallel="-n auto --dist worksteal"
if [ "${1:-all}" = fast ]; then
  step $bin/python -m pytest -q $parallel -m "not slow"
else
  step $bin/python -m pytest -q $parallel
fi
echo "check: all good" >&2
