#!/usr/bin/env bash
# Packs the packages of a build and looks at what is in them, in a folder of its own.
#
#   tests/packages/packages_test.sh BUILD
#
# Nothing is installed, and no right is needed but to write to the temporary folder.
set -euo pipefail
build=$(cd "${1:?the build folder}" && pwd)
here=$(cd "$(dirname "$0")" && pwd)
source=$(cd "$here/../.." && pwd)

work=$(mktemp -d "${TMPDIR:-/tmp}/maneuver-packages-test.XXXXXX")
server=
leave() {
  [ -z "$server" ] || { kill "$server" && wait "$server"; } 2>/dev/null || true
  rm -rf "$work"
}
trap leave EXIT
wrong() { echo "WRONG: $*" >&2; exit 1; }
cd "$work"

echo "== Pack"
(cd "$build" && cpack -G DEB -B "$work/packages" -D CPACK_DEBIAN_COMPRESSION_TYPE=gzip) >pack.log 2>&1 ||
  { cat pack.log >&2; wrong "cpack"; }
version=$(sed -n 's/^CMAKE_PROJECT_VERSION:STATIC=//p' "$build/CMakeCache.txt")-1
mkdir stage control
expected="libmaneuver-client-dev maneuver maneuver-trainer maneuverd python3-maneuver"
deb_of() { case $1 in python3-*) echo "packages/$1_${version}_all.deb" ;; *) echo "packages/$1_${version}_amd64.deb" ;; esac; }
for package in $expected; do
  deb=$(deb_of "$package")
  [ -f "$deb" ] || wrong "there is no $deb: $(ls packages)"
  dpkg --extract "$deb" stage
  dpkg --control "$deb" control/"$package"
done
[ "$(ls packages/*.deb | wc -l)" -eq 5 ] || wrong "other packages than $expected: $(ls packages)"

echo "== What each holds, with what rights"
for package in $expected; do
  # The generated headers and the documents are what proto/ and docs/ have.
  dpkg --contents "$(deb_of "$package")" |
    awk -v package="$package" '{ print package, $1, $2, $6 }' | grep -Ev '/$|\.pb\.h$|_pb2|\.proto$|\.md$|/doc/maneuverd/.*pictures/' |
    sed 's|/lib/x86_64-linux-gnu/|/lib/|' | sort
done >contents.txt
diff "$here/contents.txt" contents.txt || wrong "tests/packages/contents.txt (<) is not what was packed (>)"
for header in "$source"/proto/maneuver/v1/*.proto; do
  name=$(basename "$header" .proto)
  [ -f "stage/usr/include/maneuver/v1/$name.pb.h" ] || wrong "the header of $name.proto is not packed"
  for module in "${name}_pb2.py" "${name}_pb2.pyi"; do
    [ -f "stage/usr/lib/python3/dist-packages/maneuver/v1/$module" ] || wrong "$module is not packed"
  done
  cmp "$header" "stage/usr/share/maneuver/proto/maneuver/v1/$name.proto" || wrong "$name.proto is not packed"
done
if grep -rIl -e "$build" -e "$source" stage; then wrong "these name the folder that they were built in"; fi

echo "== What each asks for"
needs() { sed -n 's/^\(Pre-\)\?Depends: //p' "control/$1/control"; }
for package in maneuver maneuverd maneuver-trainer; do
  needs $package | grep -q 'libc6 (>=' || wrong "$package: what it is linked with is not asked for: $(needs $package)"
done
# LibTorch and OpenCV bring hundreds of megabytes each; GDAL, which comes with OpenCV's codecs, a hundred packages.
! needs maneuverd | grep -E 'torch|opencv|gdal' || wrong "the server asks for more than it needs"
! needs maneuver | grep -E 'torch|imgcodecs|gdal' || wrong "the command asks for more than it needs"
needs maneuver-trainer | grep -q libtorch || wrong "the trainer does not ask for LibTorch"
needs libmaneuver-client-dev | grep -q 'libgrpc++-dev' || wrong "the client does not ask for gRPC"
[ "$(needs python3-maneuver)" = "python3 (>= 3.9), python3-grpcio (>= 1.51), python3-protobuf (>= 3.21)" ] ||
  wrong "python3-maneuver asks for $(needs python3-maneuver)"
for script in postinst prerm; do
  sh -n "control/python3-maneuver/$script" || wrong "python3-maneuver: $script"
done
for script in postinst prerm postrm; do
  sh -n "control/maneuverd/$script" || wrong "$script"
done
[ "$(cat control/maneuverd/conffiles)" = /etc/maneuver/maneuverd.conf ] || wrong "conffiles"

echo "== Pages of the manual and completion"
for page in man1/maneuver.1 man8/maneuverd.8 man1/maneuver-trainer.1; do
  zcat "stage/usr/share/man/$page.gz" >page || wrong "$page is not packed"
  grep -q '^\.SH SYNOPSIS' page || wrong "$page has no synopsis"
  if grep -e "$build" -e "$source" page; then wrong "$page names the folder that it was built in"; fi
  if command -v groff >/dev/null; then
    said=$(groff -man -ww -z -Tutf8 page 2>&1)
    [ -z "$said" ] || wrong "$page: $said"
  fi
done
bash -n stage/usr/share/bash-completion/completions/maneuver || wrong "the completion for bash"
offered=$(bash --norc -c 'source stage/usr/share/bash-completion/completions/maneuver
  COMP_WORDS=(maneuver model pu); COMP_CWORD=2; _maneuver; echo "${COMPREPLY[@]}"')
[ "$offered" = "pull push" ] || wrong "bash offers $offered"

echo "== Configuration and unit"
settings() { stage/usr/bin/maneuverd --config "$1" --print-config; }
settings stage/etc/maneuver/maneuverd.conf >settings || wrong "the configuration is not taken"
grep -qx 'listen = "127.0.0.1:8470"' settings || wrong "it listens beyond loopback"
grep -qx 'data-dir = "/var/lib/maneuver"' settings || wrong "the state is elsewhere"
# What an administrator gets who takes the marks of comment away.
sed -E 's/^#([a-z-]+ = )/\1/' stage/etc/maneuver/maneuverd.conf >all.conf
grep -q '^tls-certificate = ' all.conf || wrong "TLS is not shown"
settings all.conf >settings || wrong "a line that is commented out is not taken"
settings "$source/deploy/container/maneuverd.conf" >/dev/null || wrong "the container's configuration is not taken"

unit=stage/usr/lib/systemd/system/maneuverd.service
of_unit() { sed -n "s/^$1=//p" "$unit"; }
shutdown=$(sed -n 's/^shutdown-timeout = //p' stage/etc/maneuver/maneuverd.conf)
[ "$(of_unit TimeoutStopSec)" -ge $((2 * shutdown + 15)) ] || wrong "systemd kills it before its shutdown-timeout of $shutdown s"
[ "$(of_unit OOMPolicy)" = continue ] || wrong "a trainer that is killed for memory would take the server with it"
grep -qx 'Environment=MANEUVERD_ROLE=%i' "${unit%.service}@.service" || wrong "the template gives no role"
[[ $(of_unit RestrictAddressFamilies) == *AF_NETLINK* ]] || wrong "ranks of a training could not find each other"
[ "$(of_unit KillMode)" = mixed ] || wrong "a stop would end trainers behind the server's back"
if command -v systemd-analyze >/dev/null; then
  systemd-analyze security --offline=true --threshold=20 "$unit" >security || { cat security; wrong "exposure"; }
  tail -n 1 security
  sed "s|=/usr/bin/maneuverd|=$work/stage/usr/bin/maneuverd|" "$unit" >maneuverd.service
  said=$(systemd-analyze verify --man=no --recursive-errors=no ./maneuverd.service 2>&1) || true
  [ -z "$said" ] || wrong "systemd-analyze verify: $said"
  sed "s|=/usr/bin/maneuverd|=$work/stage/usr/bin/maneuverd|" "${unit%.service}@.service" >maneuverd@.service
  cp maneuverd@.service maneuverd@serve.service
  said=$(systemd-analyze verify --man=no --recursive-errors=no ./maneuverd@serve.service 2>&1) || true
  [ -z "$said" ] || wrong "systemd-analyze verify of the template: $said"
else
  echo "systemd-analyze is not here: how far the unit is closed was not looked at"
fi

echo "== What was packed works: server, probe, and a program that is built with the client package"
stage/usr/bin/maneuverd --config stage/etc/maneuver/maneuverd.conf --data-dir data --listen 127.0.0.1:0 \
  --metrics-listen none --port-file ports.json >server.log 2>&1 &
server=$!
for _ in $(seq 300); do
  [ -s ports.json ] && break
  kill -0 "$server" 2>/dev/null || { cat server.log >&2; wrong "the server did not start"; }
  sleep 0.1
done
address=$(sed -n 's/.*"grpc": *"\([^"]*\)".*/\1/p' ports.json)
stage/usr/bin/maneuverd health --data-dir data --listen "$address" || wrong "the probe"
stage/usr/bin/maneuver --server "$address" health || wrong "the command"
stage/usr/bin/maneuver-trainer --help >/dev/null || wrong "the trainer"

PYTHONPATH=stage/usr/lib/python3/dist-packages /usr/bin/python3 -B - "$address" <<'EOF' || wrong "the Python package"
import importlib.metadata, sys
import maneuver
assert importlib.metadata.version("maneuver"), "it has no version"
with maneuver.Client(sys.argv[1]) as client:
    client.check_health()
    assert list(client.list_model_versions()) == []
EOF

run_cmake() { cmake "$@" >cmake.log 2>&1 || { cat cmake.log >&2; wrong "cmake $*"; }; }
run_cmake -S "$here/program" -B by-cmake -G Ninja "-DCMAKE_PREFIX_PATH=$work/stage/usr"
run_cmake --build by-cmake
by-cmake/program "$address" || wrong "the program that CMake built"
pkg_config=$(dirname "$(find stage/usr/lib -name maneuver-client.pc)")
flags=$(PKG_CONFIG_PATH=$pkg_config pkg-config --cflags --libs maneuver-client) || wrong "pkg-config"
g++ -std=c++20 "$here/program/main.cc" $flags -o by-pkg-config || wrong "the program that pkg-config built"
./by-pkg-config "$address" || wrong "the program that pkg-config built"

kill "$server"
wait "$server" || wrong "the server ended with $?"
server=
echo "All of it was as it should be."
