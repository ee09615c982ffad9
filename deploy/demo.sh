#!/bin/sh
# Sets everything up and runs the service on its simulated drive: preload falls from 10 % to 0 %
# within five minutes. Ends with Ctrl-C. Arguments go to `edge-service run`, e.g. --port 9000.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh
exec .venv/bin/edge-service run deploy/edge.toml "$@"
