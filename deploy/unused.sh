#!/bin/sh
# Prints the parts of installed packages that no program of the project loads, a path a line:
# `deploy/unused.sh FOLDER` of an environment. Their own tests, headers for compilers, and what
# Arrow has for networks and cloud storage; tests/deploy/test_unused.py holds them against a run.
set -eu
packages=$(echo "$1"/lib/python3*/site-packages)
find "$packages" -type d -name tests -prune -print
for part in include 'libarrow_flight*' 'libarrow_python_flight*' '_flight*' 'libarrow_s3*'; do
  find "$packages/pyarrow" -maxdepth 1 -name "$part" -print
done
