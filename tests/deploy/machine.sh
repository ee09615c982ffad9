#!/bin/sh
# Runs a command in a copy of this machine that forgets everything: what it writes ends with it.
# Needs the right to mount. `machine.sh FOLDER COMMAND`: FOLDER is seen inside as it is outside.
set -e
[ "$3" = inside ] || exec unshare --mount sh "$0" "$1" "$2" inside
copy=$(mktemp -d)
mount -t tmpfs tmpfs "$copy"
mkdir "$copy/written" "$copy/work" "$copy/root"
mount -t overlay overlay \
  -o "lowerdir=/,upperdir=$copy/written,workdir=$copy/work" "$copy/root"
mount --bind /dev "$copy/root/dev"
mount --bind "$1" "$copy/root$1"
exec chroot "$copy/root" sh -c "$2"
