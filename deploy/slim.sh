#!/bin/sh
# Leaves out of an environment what no program of the project needs: `deploy/slim.sh FOLDER`.
set -eu
here=$(dirname "$0")
sh "$here/unused.sh" "$1" | xargs rm -r
"$1/bin/python" "$here/strip.py" "$1"
"$1/bin/python" -m pip -qq --disable-pip-version-check uninstall --yes setuptools pip
