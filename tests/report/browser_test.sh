#!/usr/bin/env bash
# Runs browser.mjs on a report, with its packages from npm; 77 where npm or Chromium is missing.
#
#   browser_test.sh WRITE_REPORT_PAGE WORK_FOLDER
set -euo pipefail
program=$1
work=$2
source=$(cd "$(dirname "$0")" && pwd)

for need in node npm chromium; do
  command -v "$need" >/dev/null || { echo "SKIPPED: $need is not installed"; exit 77; }
done
mkdir -p "$work"
cp "$source"/{package.json,package-lock.json,browser.mjs} "$work/"
cd "$work"
if ! cmp -s package-lock.json installed; then
  if ! timeout 120 npm ci --no-audit --no-fund --ignore-scripts >npm.log 2>&1; then
    echo "SKIPPED: npm ci: $(tail -n 3 npm.log)"
    exit 77
  fi
  cp package-lock.json installed
fi
"$program" report.html
node browser.mjs report.html
