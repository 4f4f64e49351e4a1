#!/usr/bin/env bash
# Installs the Debian 12 packages that Maneuver is built from and, with --tests,
# those that only its tests run, or with --packages those that pack it. Run it as
# root, as often as you like: it does nothing when they are all there.
set -euo pipefail

packages=(
  # building
  g++ cmake ninja-build ccache lld pkg-config
  # RPC and messages
  libgrpc++-dev protobuf-compiler-grpc libprotobuf-dev protobuf-compiler libabsl-dev libssl-dev
  # mathematics, networks, learning
  libeigen3-dev libdnnl-dev libhwy-dev ocl-icd-opencl-dev opencl-headers libtorch-dev libgloo-dev
  # without it LibTorch's matrix products are some 25 times slower
  libopenblas0-openmp
  # rasters and drawings
  libopencv-core-dev libopencv-imgproc-dev libopencv-imgcodecs-dev libpng-dev
  # metrics, jobs, command line, logs, data
  prometheus-cpp-dev libcivetweb-dev libcpp-httplib-dev libsqlite3-dev libpq-dev libcli11-dev libspdlog-dev nlohmann-json3-dev libpugixml-dev zlib1g-dev
  # tests
  libgtest-dev libgmock-dev libbenchmark-dev
  # what the scripts use
  git curl ca-certificates
)
case "${1:-}" in
  --tests | --packages)
    packages+=(dpkg-dev file
      # the Python package: its messages, stubs and type hints are generated
      python3 mypy-protobuf) ;;
esac
[ "${1:-}" != --tests ] || packages+=(
  # clients that are not ours, for tests/clients; the engine that exported networks are tested with
  python3-grpcio python3-protobuf nghttp2-client libopencv-dnn-dev
  # the Python package: arrays, type checking, its wheel
  python3-numpy mypy python3-build python3-setuptools python3-wheel
  # shells that complete the command
  zsh fish
  # tests/checks, tests/fuzz
  clang clang-format clang-tidy libomp-dev
  # tests/report, with npm
  chromium
  # deploy/backup.sh, deploy/balancing, deploy/kubernetes
  haproxy openssl rsync sqlite3 python3-yaml
  # deploy/slurm
  munge slurmctld slurmd slurm-client iproute2
  # deploy/packages: systemd says how far the unit is closed
  systemd
  # --store postgresql://
  postgresql-15 postgresql-client-15 libpq5 bindfs
  # the dashboard, the alerts, Compose
  prometheus docker-compose)
# A kubectl that is there may be of another package, which Debian's cannot be installed beside.
if [ "${1:-}" = --tests ] && ! command -v kubectl >/dev/null; then packages+=(kubernetes-client); fi

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$status" = installed ] || missing+=("$package")
done
[ ${#missing[@]} -eq 0 ] && exit 0

if [ "$(id -u)" -ne 0 ]; then
  echo "install-deps: ${#missing[@]} packages are missing and only root can install them: ${missing[*]}" >&2
  exit 1
fi

echo "Installing ${#missing[@]} Debian packages ..."
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
trap 'rm -f "$log"' EXIT
install() {
  apt-get install --yes --quiet --no-install-recommends "${missing[@]}" >"$log" 2>&1
}
if ! { apt-get update --quiet >"$log" 2>&1 && install; }; then
  cat "$log" >&2
  echo "install-deps: apt-get failed; its last words are above" >&2
  exit 1
fi
# Some are for tests, which start their own: no services of this machine.
for service in haproxy prometheus munge slurmctld slurmd postgresql-15; do
  if [[ " ${missing[*]} " == *" $service "* ]] && [ -d /run/systemd/system ]; then
    systemctl disable --now --quiet "${service%-15}"
  fi
done
