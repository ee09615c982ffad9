#!/bin/sh
# Runs a plant on this computer: a router, a fleet node with its page, and simulated machines with a
# service each. All axes are healthy but one, which loses its preload within five minutes. Ends with
# Ctrl-C. `deploy/plant.sh 6` takes six machines in place of four; each needs 300 MB.
set -eu
cd "$(dirname "$0")/.."
machines=${1:-4}
case "$machines" in '' | *[!0-9]* | 0*) echo "plant: expected a number of machines, not '$machines'" >&2; exit 2 ;; esac
sh deploy/setup.sh
command=$PWD/.venv/bin/edge-service
commissioned=$PWD/deploy/commissioned.toml
router=tcp/127.0.0.1:${PLANT_PORT:-7450}
page=${PLANT_PAGE_PORT:-8090}

home=$(mktemp -d)
started=
end() {
  trap - INT TERM EXIT
  # shellcheck disable=SC2086  # several numbers
  kill -TERM $started 2>/dev/null || true
  wait
  rm -rf "$home"
}
trap end EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

start() { # NAME ARGUMENTS...: what it says goes into a file of its own
  log=$home/$1.log
  shift
  "$command" "$@" >"$log" 2>&1 &
  started="$started $!"
}

axis() { # NAME SCENARIO SEED
  printf '[[axes]]\nname = "%s"\nmachine = "%s"\ndriver = "simulated"\n' "$1" "$commissioned"
  printf '[axes.settings]\nscenario = "%s"\nstart_percent = 6.85\nseed = %s\n' "$2" "$3"
  printf 'guide_force_n = 60.0\nbearing_drag_nm = 0.05\n'
}

write_machine() { # NUMBER
  scenario=healthy
  [ "$1" != "$machines" ] || scenario=gradual
  printf '[service]\nsite = "hall-1"\nmachine = "mill-%s"\n' "$1"
  printf '[bus]\nendpoint = "tcp/127.0.0.1:0"\ntls_endpoint = "tls/127.0.0.1:0"\n[http]\nport = 0\n'
  printf '[history]\nfolder = "history-%s"\n[plant]\nendpoint = "%s"\n' "$1" "$router"
  axis X healthy "$((2 * $1))"
  axis Y "$scenario" "$((2 * $1 + 1))"
}

cat >"$home/fleet.toml" <<END
[node]
name = "fleet-1"
[plant]
endpoint = "$router"
[http]
port = $page
[history]
folder = "fleet-1"
END
start router plant router --listen "$router"
start fleet plant node "$home/fleet.toml"
number=1
while [ "$number" -le "$machines" ]; do
  write_machine "$number" >"$home/mill-$number.toml"
  start "mill-$number" run "$home/mill-$number.toml"
  number=$((number + 1))
done

cat >&2 <<END

  The plant:  http://127.0.0.1:$page/ and, in a second terminal,
              .venv/bin/edge-service fleet --plant $router
  What comes: $machines machines with two axes; axis Y of mill-$machines is new for 20 seconds, then loses its
              preload within five minutes, and moves to the top
  The end:    Ctrl-C; nothing is kept but .venv

END
# shellcheck disable=SC2086  # several numbers
for process in $started; do
  wait "$process" || { echo "plant: a part has ended:" >&2; tail -n 2 "$home"/*.log >&2; exit 1; }
done
