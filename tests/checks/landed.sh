#!/usr/bin/env bash
# Prints the last landed commit: the one that a change is compared with. The first of these that
# is an ancestor of HEAD and is not HEAD:
#
#   1. $MANEUVER_LANDED, a commit, branch or tag;
#   2. where HEAD leaves origin/main;
#   3. the commit that the file `landed` beside this script names. A change updates it to the commit
#      that it starts from; when it lags behind, more is compared.
#
# Prints nothing, says why and exits with 1 where git has no such commit.
set -euo pipefail
cd "$(dirname "$0")/../.."

refuse() { echo "landed: $*" >&2; exit 1; }
git rev-parse --verify --quiet HEAD >/dev/null || refuse "this is not a git checkout with a commit"

head=$(git rev-parse HEAD)
prints_if_before_head() {
  [ -n "$1" ] && [ "$1" != "$head" ] && git merge-base --is-ancestor "$1" HEAD 2>/dev/null && echo "$1"
}

if [ -n "${MANEUVER_LANDED:-}" ]; then
  commit=$(git rev-parse --verify --quiet "$MANEUVER_LANDED^{commit}") || commit=
  prints_if_before_head "$commit" || refuse "MANEUVER_LANDED=$MANEUVER_LANDED is not a commit before HEAD"
  exit 0
fi
prints_if_before_head "$(git merge-base HEAD origin/main 2>/dev/null || true)" && exit 0
named=$(grep -oE '^[0-9a-f]{40}$' tests/checks/landed || true)
[ -n "$named" ] || refuse "tests/checks/landed names no commit"
prints_if_before_head "$named" && exit 0
[ "$(git rev-parse --is-shallow-repository)" = false ] ||
  refuse "this clone is shallow and lacks $named; run: git fetch --unshallow"
refuse "$named, which tests/checks/landed names, is not a commit before HEAD"
