#!/bin/sh
# Makes deploy/commissioned.toml, the demo's machine file: the bench of deploy/machine.toml with
# friction of guides and bearings as a real axis has it. The axis is simulated fresh and cold, and
# commissioned on those recordings; its data sheets state table mass and nut stiffness.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh
PATH="$PWD/.venv/bin:$PATH"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

{
  echo "# The demo's axis: the bench of machine.toml, commissioned by commissioned.sh."
  echo
  sed -n '/^\[axis\]/,$p' deploy/machine.toml
  echo 'table_mass_kg = { value = 20.0, tolerance = 0.02 }'
  echo 'nut_stiffness_n_per_m = { value = 1.13e8, tolerance = 0.05 }'
} > "$scratch/nominal.toml"
{
  cat "$scratch/nominal.toml"
  echo 'guide_force_n = 60.0'
  echo 'bearing_drag_nm = 0.05'
} > "$scratch/true.toml"

edge-service simulate --machine "$scratch/true.toml" --motion production:duration_s=120 --motion friction \
    --seed 11 --out "$scratch/healthy"
edge-service commission --machine "$scratch/nominal.toml" "$scratch"/healthy/*.parquet \
    --out deploy/commissioned.toml
