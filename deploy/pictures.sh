#!/bin/sh
# Draws the pictures of the documents anew: the page of a machine (with Chromium), the motions, the healthy axis, its warm-up, the
# puzzle, and the real screw's wear where its recording is there.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh dev
PATH="$PWD/.venv/bin:$PATH"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

sed '/^\[model\]/a guide_force_n = 150.0\ntable_mass_kg = 20.0' deploy/machine.toml > "$scratch/m.toml"
cd "$scratch"
thin="--effect stribeck:excess_nm=0.1,speed_rad_s=4"
rough="--effect torque_ripple:amplitude_nm=0.02 --effect once_per_rev_friction:amplitude_nm=0.01"
cold="--effect warmup:excess_nm=0.08,time_constant_s=600"
again="--motion warmup:duration_s=300 --motion friction"

# shellcheck disable=SC2086
edge-service simulate --machine m.toml --motion friction --motion signature --motion acceleration \
    --motion reversals --motion multisine $thin $rough --out healthy
edge-service fingerprint --machine m.toml healthy/*.parquet --out healthy
# shellcheck disable=SC2086
edge-service simulate --machine m.toml --motion friction $again $again $again $again \
    $thin $cold --out runs
edge-service fingerprint --machine m.toml runs/*.parquet --out runs
python - << 'EOS'
from pathlib import Path

from edge_service.fingerprint.result import read_fingerprint
from edge_service.offline.report.fingerprint_page import draw_sections
from edge_service.offline.report.page import write_png

for folder in (Path("healthy"), Path("runs")):
    for name, figure in draw_sections(read_fingerprint(folder / "fingerprint.json"), None).items():
        write_png(figure, folder / f"{name}.png")
EOS
edge-service reproduce puzzle --out puzzle

cd "$OLDPWD"
python -m tests.page.picture deploy/pictures/dashboard.png
for name in friction stiffness frequency_response signature; do
    cp "$scratch/healthy/$name.png" "deploy/pictures/$name.png"
done
wear=../shared/data/xjtu_wear/lower_screw_drag_nm.txt
if [ -f "$wear" ]; then
    edge-service reproduce wear "$wear" --out "$scratch/wear"
    cp "$scratch/wear/wear.png" deploy/pictures/wear.png
fi
cp "$scratch/runs/friction_runs.png" "$scratch/puzzle/puzzle.png" deploy/pictures/
