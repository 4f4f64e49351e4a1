# A maneuverd to be measured, for the scripts beside this one, which source it: `start_server` gives them
# $server (its process), $metrics and MANEUVER_SERVER; `stop_server` ends it. $bin is where the programs are, $work a folder that
# goes, as the server does, when the script ends.
#
# What callers take, the server would not have: they get the last quarter of the cores (at least one) and
# the server the others. SHARED=1, or a single core: all of them share all cores.

bin=${BIN:-$(dirname "${BASH_SOURCE[0]}")/../../build/release/bin}
work=$(mktemp -d)
server=
stop_server() {
  [ -z "$server" ] || { kill "$server" 2>/dev/null; wait "$server" 2>/dev/null; } || true
  server=
  rm -f "$work/ports.json"
}
finish() {
  stop_server
  rm -rf "$work"
}
trap finish EXIT

cores=$(nproc)
server_cores=0-$((cores - 1))
niceness=5
if [ -z "${SHARED:-}" ] && [ "$cores" -gt 1 ]; then
  callers=$(((cores + 3) / 4))
  server_cores=0-$((cores - callers - 1))
  niceness=0
  taskset -pc "$((cores - callers))-$((cores - 1))" $$ >/dev/null
fi

# version N MODEL_FOLDER: what models/measured/versions/N is to be. Before the server starts.
version() {
  mkdir -p "$work/data/models/measured"
  cp -r "$2" "$work/data/models/measured/$1"
}

# start_server [flags of maneuverd]. Callers on the same cores have to be punctual: they come first.
start_server() {
  taskset -c "$server_cores" nice -n "$niceness" "$bin/maneuverd" --data-dir "$work/data" --listen 127.0.0.1:0 \
    --metrics-listen 127.0.0.1:0 --port-file "$work/ports.json" "$@" \
    >"$work/maneuverd.out" 2>"$work/maneuverd.log" &
  server=$!
  for _ in $(seq 3000); do
    [ ! -s "$work/ports.json" ] || break
    kill -0 "$server" 2>/dev/null || { cat "$work/maneuverd.log" >&2; exit 1; }
    sleep 0.01
  done
  MANEUVER_SERVER=$(sed -n 's/.*"grpc": *"\([^"]*\)".*/\1/p' "$work/ports.json")
  metrics=$(sed -n 's/.*"metrics": *"\([^"]*\)".*/\1/p' "$work/ports.json")
  export MANEUVER_SERVER
}

# Figure $2 of file $1, such as steps.0.latency_ms.p99; 0 if it is not there, - if it is not known.
figure() {
  awk -v wanted="$2" '
    { match($0, /^ */); depth = RLENGTH / 2; line = substr($0, RLENGTH + 1) }
    line ~ /^\{/ { path[depth] = elements[depth]++ + 0 }
    line ~ /^"/ {
      key = line; sub(/^"/, "", key); sub(/":.*/, "", key); path[depth] = key
      name = path[1]
      for (i = 2; i <= depth; i++) name = name "." path[i]
      if (name == wanted) { sub(/^"[^"]*": /, "", line); gsub(/[",]/, "", line); value = line }
    }
    END { print value == "" ? 0 : value == "null" ? "-" : value }' "$1"
}
