#!/usr/bin/env bash
# Makes a data folder from a back-up that deploy/backup.sh made, after checking that
# each of its files still has the bytes that it was written with.
#
#   deploy/restore.sh BACKUP DATA_DIR [--owner USER] [--store URI | --folder-only]
#
# --store names an empty database for a back-up whose jobs and aliases were in PostgreSQL.
# --folder-only restores the files alone, for a database that is still there.
# DATA_DIR must not be there yet, or be empty. Afterwards start maneuverd over it, as its
# user: it serves what served, and jobs that had not ended go on from their checkpoints.
# --owner gives the files to that user (needs root).
set -euo pipefail
umask 077

usage() { sed -n '2,11s/^# \{0,1\}//p' "$0"; }
refuse() { echo "restore: $1" >&2; exit "${2:-2}"; }
owner=
store=
folder_only=false
positional=()
while [ $# -gt 0 ]; do
  case "$1" in
    --owner) owner=${2:?--owner needs a user}; shift ;;
    --store) store=${2:?--store needs a URI}; shift ;;
    --folder-only) folder_only=true ;;
    -h|--help) usage; exit 0 ;;
    -*) refuse "unknown option $1; see --help" ;;
    *) positional+=("$1") ;;
  esac
  shift
done
[ ${#positional[@]} -eq 2 ] || { usage >&2; exit 2; }
backup=${positional[0]%/}
data=${positional[1]%/}
[ -z "$owner" ] || id -u "$owner" >/dev/null 2>&1 ||
  refuse "there is no user $owner; install the package of the server first, or leave out --owner"
[ -f "$backup/SHA256SUMS" ] || refuse "$backup is not a back-up: it has no SHA256SUMS"
[ ! -e "$data" ] || [ -z "$(ls -A "$data")" ] || refuse "$data is not empty; restore to a new folder"
if [ -f "$backup/maneuver.dump" ]; then
  if $folder_only; then
    [ -z "$store" ] || refuse "--folder-only leaves the database alone; leave out --store"
  else
    [ -n "$store" ] || refuse "jobs and aliases of $backup were in PostgreSQL; name an empty database with --store, or, if theirs is still there, give --folder-only"
    command -v pg_restore >/dev/null || refuse "pg_restore is not installed: apt-get install postgresql-client"
  fi
elif $folder_only; then
  refuse "$backup has its jobs and aliases in maneuver.db; restore it without --folder-only"
elif [ -n "$store" ]; then
  refuse "$backup has its jobs and aliases in maneuver.db; restore it without --store"
fi

(cd "$backup" && sha256sum --check --strict --quiet SHA256SUMS) ||
  refuse "$backup is damaged: see the files above" 1

[ -z "$store" ] ||
  pg_restore --exit-on-error --single-transaction --no-owner --dbname="$store" "$backup/maneuver.dump" ||
  refuse "the database was not restored; it has to be empty. If it is the one of this back-up, and alive, give --folder-only in place of --store" 1
mkdir -p "$data"
# Its own files, not links to those of the back-up: the server changes some of them.
cp -a "$backup/." "$data/"
rm -f "$data/SHA256SUMS" "$data/maneuver.dump"
[ -z "$owner" ] || chown -R "$owner:" "$data"
sync -f "$data"
$folder_only && store=URI
echo "$data: restored; start the server over it${owner:+ as $owner}: systemctl start maneuverd, or: ${owner:+sudo -u $owner }maneuverd --data-dir $data${store:+ --store URI}"
