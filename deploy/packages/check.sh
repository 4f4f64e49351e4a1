#!/usr/bin/env bash
# Installs, uses, upgrades, removes and purges the packages on a plain Debian 12 that it boots, with
# systemd, in a folder; ends with 0 if all went as it should.
#
#   cpack --preset portable
#   deploy/packages/check.sh [--base FOLDER] [--keep] [PACKAGES]
#
# PACKAGES    where the .deb files are; build/portable/packages unless given
# --base      a plain Debian 12 to copy, in place of one that debootstrap fetches
# --keep      leaves the folder, and says where it is
#
# Wants root, systemd-nspawn (Debian: systemd-container) and, without --base, debootstrap. Debian's
# packages come by the network; the system that is booted sees none but its own loopback. It takes
# 3 GB of disk and some minutes, most of them for LibTorch and one small training.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)

base=
keep=false
packages=$here/../../build/portable/packages
usage() { sed -n '2,15s/^# \{0,1\}//p' "$0"; }
while [ $# -gt 0 ]; do
  case "$1" in
    --base) base=${2:?--base needs a folder}; shift ;;
    --keep) keep=true ;;
    -h|--help) usage; exit 0 ;;
    -*) echo "check: unknown option $1; see --help" >&2; exit 2 ;;
    *) packages=$1 ;;
  esac
  shift
done
packages=$(cd "$packages" && pwd)
[ "$(id -u)" -eq 0 ] || { echo "check: only root can boot a system in a folder" >&2; exit 2; }

step() { printf '\n\033[1m== %s\033[0m (%d s)\n' "$*" "$SECONDS"; }
work=$(mktemp -d "${TMPDIR:-/tmp}/maneuver-packages.XXXXXX")
root=$work/root
boot=
leader=
leave() {
  local status=$?
  # The container ends with its first process; so does all that runs in it.
  if [ -n "$leader" ]; then kill -KILL "$leader" || true; fi
  if [ -n "$boot" ]; then wait "$boot" || true; fi
  mountpoint -q "$root/proc" && umount "$root/proc"
  if $keep; then echo "check: all is in $work"; else rm -rf --one-file-system "$work"; fi
  exit "$status"
}
trap leave EXIT

step "The programs in the packages are hardened"
for name in maneuverd maneuver maneuver-trainer; do dpkg-deb --extract "$packages/$name"_*.deb "$work/programs"; done
"$here/../../tests/packages/hardening_test.sh" "$work"/programs/usr/bin/{maneuverd,maneuver,maneuver-trainer}

step "A plain Debian 12"
if [ -n "$base" ]; then
  cp -a "$base" "$root"
else
  debootstrap --variant=minbase bookworm "$root" >"$work/debootstrap.log"
fi
mkdir "$root/packages"
cp -r "$packages"/*.deb "$here"/check_inside.sh "$here"/small_training.json "$here"/../../tests/packages/program "$root/packages/"
# The same server and trainer once more, as an upgrade.
for name in maneuverd maneuver-trainer; do
  next=$work/next-$name
  dpkg-deb --raw-extract "$packages/$name"_*.deb "$next"
  version=$(sed -n 's/^Version: //p' "$next/DEBIAN/control")
  sed -i "s/$version/$version+next/g" "$next/DEBIAN/control"
  mkdir -p "$root/packages/next"
  dpkg-deb --build --root-owner-group "$next" "$root/packages/next" >/dev/null
done
# What the packages depend on is fetched now: inside there is no network.
mount -t proc proc "$root/proc"
outside() { chroot "$root" env DEBIAN_FRONTEND=noninteractive "$@" >>"$work/apt.log" 2>&1 || { tail "$work/apt.log" >&2; return 1; }; }
outside apt-get update
outside apt-get install --yes --no-install-recommends systemd systemd-sysv dbus procps
echo 'Binary::apt::APT::Keep-Downloaded-Packages "true";
APT::Keep-Downloaded-Packages "true";' >"$root/etc/apt/apt.conf.d/90keep"
download() { outside apt-get install --yes --no-install-recommends --download-only "$@"; }
download $(cd "$root" && ls packages/maneuver_*.deb packages/maneuverd_*.deb | sed 's|^|/|')
download cmake g++ make pkg-config $(cd "$root" && ls packages/*.deb | sed 's|^|/|')
umount "$root/proc"

step "Boot"
systemd-nspawn --quiet --register=no --keep-unit --private-network --directory "$root" --boot \
  >"$work/boot.log" 2>&1 </dev/null &
boot=$!
inside() {
  nsenter --target "$leader" --all --wd env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    DEBIAN_FRONTEND=noninteractive HOME=/root LC_ALL=C.UTF-8 "$@"
}
for _ in $(seq 120); do
  leader=$(pgrep --parent "$boot" || true)
  [ -n "$leader" ] && inside systemctl is-system-running 2>/dev/null | grep -Eq 'running|degraded' && break
  sleep 0.5
done
inside systemctl is-system-running | grep -Eq 'running|degraded' ||
  { tail "$work/boot.log" >&2; echo "check: the system did not come up" >&2; exit 1; }

inside bash /packages/check_inside.sh
step "All of it was as it should be"
