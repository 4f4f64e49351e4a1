#!/usr/bin/env bash
# Checks that the internals of other libraries are named in one file each, which asserts the version.
set -euo pipefail
cd "$(dirname "$0")/../.."

# What is internal (an extended regular expression) = the file that may name it, if any.
borders=(
  'grpc::internal|server_callback_handlers\.h|InternalInlineable=server/rpc/grpc_internals.h'
  'protobuf::internal|<google/protobuf/(stubs/common|wire_format)=server/rpc/protobuf_internals.h'
  'Eigen::internal='
)
failed=0
for border in "${borders[@]}"; do
  file=${border##*=}
  if git grep --untracked -nE "${border%=*}" -- '*.cc' '*.h' ${file:+":!$file"}; then
    echo "borders: the lines above name internals of a library; only ${file:-no file} may" >&2
    failed=1
  fi
  [ -z "$file" ] || grep -q static_assert "$file" || { echo "borders: $file asserts no version" >&2; failed=1; }
done
[ $failed -eq 0 ] || exit 1
echo "borders: internals of ${#borders[@]} libraries are named where they may be"
