#!/usr/bin/env bash
# Backs up a data folder: models, aliases, datasets, tags, outcomes, jobs and their checkpoints.
# The server may run meanwhile, and its jobs with it.
#
#   deploy/backup.sh DATA_DIR BACKUP [--previous OTHER_BACKUP] [--without-datasets] [--store URI]
#
# --store names the database of jobs and aliases, as for maneuverd, where they are in PostgreSQL.
# BACKUP is made, and must not exist; it appears under its name once it is
# whole. With --previous what has not changed since takes no space again (hard
# links; on the same file system). deploy/restore.sh makes a data folder of it.
# Needs rsync and sqlite3, or pg_dump for --store. Run it as the server's user, or as root.
set -euo pipefail
umask 077  # as the data folder: jobs have settings and logs

usage() { sed -n '2,12s/^# \{0,1\}//p' "$0"; }
refuse() { echo "backup: $1" >&2; exit 2; }
folders=(models jobs tags outcomes datasets)
dumped=()
previous=
store=
positional=()
while [ $# -gt 0 ]; do
  case "$1" in
    --previous) previous=$(realpath -e -- "${2:?--previous needs a back-up}"); shift ;;
    --store) store=${2:?--store needs a URI}; shift ;;
    # Their list too: names whose folder is missing could not be uploaded again.
    --without-datasets) folders=(models jobs tags outcomes); dumped=(--exclude-table-data='*.datasets') ;;
    -h|--help) usage; exit 0 ;;
    -*) refuse "unknown option $1; see --help" ;;
    *) positional+=("$1") ;;
  esac
  shift
done
[ ${#positional[@]} -eq 2 ] || { usage >&2; exit 2; }
data=${positional[0]%/}
backup=${positional[1]%/}
if [ -f "$data/store-id" ]; then
  [ -n "$store" ] || refuse "jobs and aliases of $data are in PostgreSQL; name the database with --store"
  database=pg_dump
else
  [ -z "$store" ] || refuse "$data does not belong to a database of --store: it has no store-id"
  [ -f "$data/maneuver.db" ] || refuse "$data is not a data folder of maneuverd: it has no maneuver.db"
  database=sqlite3
fi
[ ! -e "$backup" ] || refuse "$backup is already there; give another name"
for program in rsync "$database"; do
  command -v "$program" >/dev/null || refuse "$program is not installed: apt-get install rsync ${database/pg_dump/postgresql-client}"
done

unfinished="$backup.unfinished"
rm -rf "$unfinished" "$unfinished.log"
trap 'rm -rf "$unfinished" "$unfinished.log"' EXIT
mkdir -p "$unfinished"

# What is there under its final name is whole and never changes but in one step
# (written beside it, renamed); what is being written, or was begun to be uploaded,
# has a name with a dot before it.
copy() {  # copy FOLDER [flags]: 24, as rsync says it, if something went away meanwhile
  local folder=$1 links=()
  [ -d "$data/$folder" ] || return 0
  [ -z "$previous" ] || [ ! -d "$previous/$folder" ] || links=("--link-dest=$previous/$folder")
  rsync -a --modify-window=-1 --exclude '.*.tmp-*' --exclude /.uploads "${links[@]}" "${@:2}" \
    "$data/$folder/" "$unfinished/$folder/" 2>>"$unfinished.log"
}
copy_all() {  # copy_all [flags]: no folder of a model or a dataset is there in part
  local folder status
  for folder in "${folders[@]}"; do
    for _ in $(seq 20); do
      status=0
      copy "$folder" "$@" || status=$?
      # Of jobs and outcomes the files come and go all the time, each for itself.
      [ "$status" -eq 24 ] && [[ $folder != jobs && $folder != outcomes ]] || break
    done
    if [ "$status" -ne 0 ] && ! { [ "$status" -eq 24 ] && [[ $folder == jobs || $folder == outcomes ]]; }; then
      cat "$unfinished.log" >&2
      echo "backup: $data/$folder could not be copied (rsync: $status)" >&2
      exit 1
    fi
  done
}
# Files, the database as it is at one moment, then the files that have come since:
# whatever the database names is there, whether it came or went meanwhile.
copy_all --delete
if [ -n "$store" ]; then
  cp -p "$data/store-id" "$unfinished/store-id"
  pg_dump --format=custom --no-owner --no-privileges "${dumped[@]}" --file="$unfinished/maneuver.dump" --dbname="$store"
  id=$(pg_restore --data-only --table=store --file=- "$unfinished/maneuver.dump")
  [[ $id == *"$(cat "$data/store-id")"* ]] || refuse "the database of --store is not the one that $data belongs to"
else
  sqlite3 "$data/maneuver.db" ".timeout 60000" ".backup '$unfinished/maneuver.db'"
fi
copy_all
[ -n "$store" ] || [ "$(sqlite3 "$unfinished/maneuver.db" 'PRAGMA journal_mode = DELETE; PRAGMA integrity_check')" = $'delete\nok' ] ||
  { echo "backup: the copy of maneuver.db is damaged" >&2; exit 1; }

(cd "$unfinished" && find . -type f ! -name SHA256SUMS -print0 | LC_ALL=C sort -z | xargs -0r sha256sum >SHA256SUMS)
sync -f "$unfinished"
mv -T "$unfinished" "$backup"
sync -f "$(dirname "$backup")"
echo "$backup: $(wc -l <"$backup/SHA256SUMS") files, $(du -sh "$backup" | cut -f1)"
