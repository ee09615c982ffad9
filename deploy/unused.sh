#!/bin/sh
# Prints the parts of installed packages that no program of the project loads, a path a line:
# `deploy/unused.sh FOLDER` of an environment. Their own tests, sources for compilers and
# translators, second copies of a library, what Arrow has for networks and cloud storage, pools of
# threads, and what reads, writes or paints files of other kinds; tests/deploy/test_unused.py holds
# them against a run.
set -eu
cd "$1"/lib/python3*/site-packages
find "$PWD" -type d \( -name tests -o -name sboms -o -path '*/pyarrow/include' -o \
  -path '*/pyarrow/src' -o -path '*/mpl-data/fonts/afm' -o -path '*/mpl-data/sample_data' -o \
  -path '*/scipy/odr' -o -path '*/numpy/distutils' -o -path '*/pytz/zoneinfo' \) -prune -print -o \
  -type f \( -name '*.[cah]' -o -name '*.p[xy][dix]' -o -name '*.po' -o -path '*/fontTools/*.so' -o \
  -name '_fmm_core*.so' -o -path '*/pillow.libs/libavif*' -o -path '*/PIL/_avif*' -o \
  -path '*/PIL/_webp*' -o -path '*/PIL/_imaging[cf]*' -o -path '*/pillow.libs/liblcms2*' -o \
  -path '*/pillow.libs/lib[bfhsw]*' -o -path '*/zstandard/_cffi*' -o -path '*/ufunc/*pool.*.so' -o \
  -path '*/pyarrow/*_flight*' -o -path '*/pyarrow/libarrow_s3*' -o -path '*/pyarrow/_orc*' -o \
  -path '*/pyarrow/_substrait*' -o -path '*/pyarrow/_*[zs]*fs.*.so' -o -name '_*_encryption*.so' -o \
  -name '_pyarrow_*tests*.so' -o -path '*/pygments/lexers/[!_p]*.py' -o \
  -path '*/pygments/lexers/p[!y]*.py' -o -name '_simd.*.so' -o \
  -name 'libarrow_python*.so' -o -name 'libarrow_python*.so.*.*' \) -print
