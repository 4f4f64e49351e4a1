#!/usr/bin/env bash
# Runs a server for long under a mixed load, and fails if memory, descriptors, threads or disk grow.
#
#   tests/soak/run.sh --hours 2           # or --minutes 5, the short form
#
# The other options are those of soak.py. Needs the release build, openssl and Python's gRPC.
set -euo pipefail
cd "$(dirname "$0")/../.."
export PYTHONPATH=${PYTHONPATH:-$PWD/build/release/python} PYTHONDONTWRITEBYTECODE=1
exec /usr/bin/python3 tests/soak/soak.py "$@"
