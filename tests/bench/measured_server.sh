# A maneuverd to be measured, for the scripts beside this one, which source it: `start_server` gives them
# $server (its process), $metrics and MANEUVER_SERVER. $bin is where the programs are, $work a folder that
# goes, as the server does, when the script ends.
#
# What callers take, the server would not have: they get the last quarter of the cores (at least one) and
# the server the others. SHARED=1, or a single core: all of them share all cores.

bin=${BIN:-$(dirname "${BASH_SOURCE[0]}")/../../build/release/bin}
work=$(mktemp -d)
server=
finish() {
  [ -z "$server" ] || { kill "$server" 2>/dev/null; wait "$server" 2>/dev/null; } || true
  rm -rf "$work"
}
trap finish EXIT

cores=$(nproc)
server_cores=0-$((cores - 1))
if [ -z "${SHARED:-}" ] && [ "$cores" -gt 1 ]; then
  callers=$(((cores + 3) / 4))
  server_cores=0-$((cores - callers - 1))
  taskset -pc "$((cores - callers))-$((cores - 1))" $$ >/dev/null
fi

# version N MODEL_FOLDER: what models/measured/versions/N is to be. Before the server starts.
version() {
  mkdir -p "$work/data/models/measured"
  cp -r "$2" "$work/data/models/measured/$1"
}

# start_server [flags of maneuverd]. Callers on the same cores have to be punctual: they come first.
start_server() {
  taskset -c "$server_cores" nice -n 5 "$bin/maneuverd" --data-dir "$work/data" --listen 127.0.0.1:0 \
    --metrics-listen 127.0.0.1:0 --port-file "$work/ports.json" "$@" \
    >"$work/maneuverd.out" 2>"$work/maneuverd.log" &
  server=$!
  for _ in $(seq 300); do
    [ ! -s "$work/ports.json" ] || break
    kill -0 "$server" 2>/dev/null || { cat "$work/maneuverd.log" >&2; exit 1; }
    sleep 0.1
  done
  MANEUVER_SERVER=$(sed -n 's/.*"grpc": *"\([^"]*\)".*/\1/p' "$work/ports.json")
  metrics=$(sed -n 's/.*"metrics": *"\([^"]*\)".*/\1/p' "$work/ports.json")
  export MANEUVER_SERVER
}
