#!/bin/sh
# Runs a compiler through ccache: ccache.sh CCACHE COMPILER ARGUMENT...
#
# Removes a precompiled header before it is made anew. While the old one is there, the preprocessor
# reads it in place of the headers, so ccache would look the new one up by what the headers were.
ccache=$1
shift
before=
for argument in "$@"; do
  case "$before $argument" in "-o "*.gch) rm -f "$argument" ;; esac
  before=$argument
done
exec "$ccache" "$@"
