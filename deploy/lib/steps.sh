# SPDX-License-Identifier: GPL-3.0-or-later
# Shared by the commands in deploy/: steps that say what they do and fail with their name.
# shellcheck shell=bash
set -euo pipefail

repository=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
started=$SECONDS

# step NAME COMMAND...: runs the command with its output in build/logs/NAME.log; shows the log only where it fails.
step() {
  local name=$1 log begun=$SECONDS
  shift
  log="$repository/build/logs/${name// /-}.log"
  mkdir -p "$repository/build/logs"
  printf '==> %s ... ' "$name"
  if "$@" >"$log" 2>&1; then
    printf 'done in %d s\n' $((SECONDS - begun))
  else
    local code=$?
    printf 'FAILED after %d s\n' $((SECONDS - begun))
    tail -n 60 "$log"
    printf '%s: step "%s" failed (exit code %d); the whole log is %s\n' "$(basename "$0")" "$name" "$code" "$log" >&2
    exit "$code"
  fi
}

# loud_step NAME COMMAND...: the same with the output shown as it comes.
loud_step() {
  local name=$1 begun=$SECONDS
  shift
  printf '==> %s\n' "$name"
  if "$@"; then
    printf '==> %s: done in %d s\n' "$name" $((SECONDS - begun))
  else
    local code=$?
    printf '%s: step "%s" failed (exit code %d)\n' "$(basename "$0")" "$name" "$code" >&2
    exit "$code"
  fi
}

# as_root COMMAND...: as it is for root, with sudo for others.
as_root() {
  if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi
}
