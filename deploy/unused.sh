#!/bin/sh
# Prints the parts of installed packages that no program of the project loads, a path a line:
# `deploy/unused.sh FOLDER` of an environment. Their own tests, sources for compilers and
# translators, second copies of a library, what Arrow has for networks and cloud storage, and what
# reads or writes files of other kinds; tests/deploy/test_unused.py holds them against a run.
set -eu
cd "$1"/lib/python3*/site-packages
find "$PWD" -type d \( -name tests -o -path '*/pyarrow/include' -o -path '*/pyarrow/src' -o \
  -path '*/mpl-data/fonts/afm' -o -path '*/scipy/odr' \) -prune -print -o \
  -type f \( -name '*.[cah]' -o -name '*.p[xy][dix]' -o -name '*.po' -o -path '*/fontTools/*.so' -o \
  -name '_fmm_core*.so' -o -path '*/pillow.libs/libavif*' -o -path '*/PIL/_avif*' -o \
  -path '*/pyarrow/*_flight*' -o -path '*/pyarrow/libarrow_s3*' -o -name '_pyarrow_*tests*.so' -o \
  -name 'libarrow_python*.so' -o -name 'libarrow_python*.so.*.*' \) -print
