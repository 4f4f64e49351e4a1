#!/usr/bin/env bash
# Runs the maintainer scripts of maneuverd in a folder in place of /, with programs in place of systemd's that
# write down what they are asked. deploy/packages/check.sh runs them in a system that it boots.
set -euo pipefail
scripts=$(cd "$(dirname "$0")/../../deploy/packages/maneuverd" && pwd)

work=$(mktemp -d "${TMPDIR:-/tmp}/maneuver-scripts-test.XXXXXX")
trap 'rm -rf "$work"' EXIT
wrong() { echo "WRONG: $*" >&2; exit 1; }
mkdir -p "$work"/{bin,run/systemd/system,etc/systemd/system/multi-user.target.wants,etc/maneuver,var/lib/maneuver/models}

# program NAME LINE: what it does.
program() { printf '#!/bin/sh\n%s\n' "$2" >"$work/bin/$1" && chmod +x "$work/bin/$1"; }
program deb-systemd-helper 'exit 0'
program deb-systemd-invoke 'echo "$@" >>"$ROOT/asked"'
program systemctl 'case "$*" in *list-units*) cat "$ROOT/loaded" ;; esac'
program getent 'exit 0'
program mountpoint '[ -e "$ROOT/mounted" ]'

run() { # run SCRIPT ARGUMENTS...: with its paths put into the folder
  : >"$work/asked"
  sed -E "s#(^|[^[:alnum:]_.])/(etc|run|var)/#\1$work/\2/#g" "$scripts/$1" >"$work/script"
  ROOT=$work PATH=$work/bin:$PATH sh "$work/script" "${@:2}" 2>"$work/errors" || wrong "$1 ${*:2}: $(cat "$work/errors")"
}
asked() { [ "$(sort "$work/asked")" = "$(printf '%s\n' "$@")" ] || wrong "$what: asked for $(cat "$work/asked")"; }
instance=$work/etc/systemd/system/multi-user.target.wants/maneuverd@work.service

what="an upgrade restarts the server and the instances that run"
echo "maneuverd@serve.service loaded active running" >"$work/loaded"
run postinst configure 0.0.9-1
asked "restart maneuverd.service" "restart maneuverd@serve.service"

what="a removal stops them"
run prerm remove
asked "stop maneuverd.service" "stop maneuverd@serve.service"
run prerm upgrade 0.2.0-1
[ ! -s "$work/asked" ] || wrong "an upgrade stops $(cat "$work/asked") before the new version is there"

what="an installation after a removal starts the instances that are enabled"
: >"$work/loaded"
ln -s /lib/systemd/system/maneuverd@.service "$instance"
run postinst configure 0.1.0-1
asked "restart maneuverd.service" "restart maneuverd@work.service"

run postrm remove
[ -d "$work/var/lib/maneuver/models" ] || wrong "a removal deletes the state"
touch "$work/mounted"
run postrm purge
[ -d "$work/var/lib/maneuver/models" ] || wrong "a purge deletes what is on a mounted volume"
[ ! -L "$instance" ] || wrong "a purge leaves the links of instances"
rm "$work/mounted"
run postrm purge
[ ! -e "$work/var/lib/maneuver" ] || wrong "a purge leaves the state"
[ ! -e "$work/etc/maneuver" ] || wrong "a purge leaves the folder of the configuration"
echo "The scripts do what they should."
