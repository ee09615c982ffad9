#!/bin/sh
# Everything that must hold: formatting, lint, types, the rules of the house, tests.
# Without a word the fast tests and a smoke test of each slow kind; `deploy/check.sh all` runs every test.
set -eu
cd "$(dirname "$0")/.."
step() { echo "check: $*" >&2; "$@"; }

# What the tests use besides: a browser for the page, a Prometheus that scrapes, a Modbus device and
# an MQTT broker that nobody here wrote, what looks at the Debian package, two reverse proxies. Without
# them, and without the right to install them, their tests are skipped and say so.
complete() {
  for tool in chromium prometheus gcc lintian; do command -v "$tool" >/dev/null 2>&1 || return 1; done
  [ -e /usr/include/modbus/modbus.h ] && [ -x /usr/sbin/mosquitto ] &&
    [ -x /usr/sbin/nginx ] && [ -x /usr/bin/caddy ]
}
install_tools() {
  complete || [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null 2>&1 || {
    echo "check: installing chromium, prometheus, libmodbus, mosquitto, lintian, nginx and caddy" >&2
    apt-get update -qq && RUNLEVEL=1 DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
      --no-install-recommends chromium fonts-dejavu-core prometheus gcc libc6-dev libmodbus-dev \
      mosquitto lintian python3-venv nginx-light caddy curl
  } >/dev/null 2>&1 || echo "check: they cannot all be installed; tests of what is missing are skipped" >&2
}
install_tools & # while packages are fetched
tools=$!
sh deploy/setup.sh dev
bin=.venv/bin
# A reader of Sparkplug that nobody here wrote. It asks for paho-mqtt 1, but its codec needs none.
$bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes \
  -r deploy/requirements-sparkplug.lock
wait $tools
export EDGE_SERVICE_CHECK=1 # the schema's tester is here: its test is not skipped

sh deploy/setup.sh kernels & # on one core, while the other checks types
kernels=$!
step $bin/ruff format --check --quiet .
step $bin/ruff check --quiet .
step $bin/lint-imports --no-logo
step $bin/mypy --no-error-summary
wait $kernels
chosen="not slow or smoke"
[ "${1:-}" != all ] || chosen="slow or not slow"
# A process per core: no test shares a port, a cache or a folder with another.
step $bin/python -m pytest -q -n auto --dist worksteal --durations=50 -m "$chosen"
echo "check: all good" >&2
