#!/bin/sh
# Sets everything up and runs the service on its simulated drive: preload falls from 10 % to 0 %
# within five minutes. Ends with Ctrl-C. Arguments go to `edge-service run`, e.g. --port 9000.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh

port=8080
before=
for argument in "$@"; do
  case "$argument" in --port=*) port=${argument#--port=} ;; esac
  [ "$before" != --port ] || port=$argument
  before=$argument
done

cat >&2 <<END

  $(.venv/bin/edge-service --version)
  The page:   http://127.0.0.1:$port/
  What comes: the screw is new for 20 seconds, then loses its preload: NORMAL, WARNING and FAULT
              within five minutes
  The end:    Ctrl-C; nothing is kept but .venv

END
exec .venv/bin/edge-service run deploy/edge.toml "$@"
