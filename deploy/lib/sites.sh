# SPDX-License-Identifier: GPL-3.0-or-later
# Both daemons on loopback, with the virtual devices of machines sped up 2,000 times. Source steps.sh first.
# shellcheck shell=bash

# start_sites FOLDER MACHINES BIN [OPTION...]: begins again in FOLDER with the profiles named, OPTIONs to the fab; ends
# both with the script. Sets scan_site, fab_site and fab_page.
start_sites() {
  local folder=$1 machines=$2 bin=$3 machine profile
  shift 3
  rm -rf "$folder" && mkdir -p "$folder/machines"
  for machine in $machines; do
    profile=$repository/deploy/config/machines/$machine.toml
    [ -f "$profile" ] || { echo "$(basename "$0"): no machine $machine in deploy/config/machines" >&2; exit 2; }
    { cat "$profile"; printf '\n[devices]\nspeed_up = 2000.0\n'; } >"$folder/machines/$machine.toml"
  done
  site_processes=()
  trap end_sites EXIT
  start_daemon "$folder" fab "$bin/telefab-fab" serve --listen 127.0.0.1:0 --web 127.0.0.1:0 --data "$folder/fab" --machines "$folder/machines" "$@"
  start_daemon "$folder" scan "$bin/telefab-scan" serve --listen 127.0.0.1:0 --fab "127.0.0.1:$(cat "$folder/fab/port")" \
    --data "$folder/scan" --machines "$folder/machines"
  scan_site=127.0.0.1:$(cat "$folder/scan/port")
  fab_site=127.0.0.1:$(cat "$folder/fab/port")
  # shellcheck disable=SC2034  # for the script that sources this
  fab_page=http://127.0.0.1:$(cat "$folder/fab/web-port")/
}

# start_daemon FOLDER NAME COMMAND...: in the background; ready once it has written FOLDER/NAME/port.
start_daemon() {
  local folder=$1 name=$2 tries=0
  shift 2
  "$@" >"$folder/telefab-$name.log" 2>&1 &
  site_processes+=($!)
  until [ -s "$folder/$name/port" ]; do
    if ! kill -0 "${site_processes[-1]}" 2>/dev/null || [ $((tries += 1)) -gt 100 ]; then
      cat "$folder/telefab-$name.log"
      echo "$(basename "$0"): step \"start telefab-$name\" failed; the log is $folder/telefab-$name.log" >&2
      exit 3
    fi
    sleep 0.1
  done
  echo "==> telefab-$name listens on 127.0.0.1:$(cat "$folder/$name/port")"
}

end_sites() {
  for process in "${site_processes[@]}"; do kill "$process" 2>/dev/null || true; done
  wait 2>/dev/null || true
}

# take_packages FOLDER TO: unpacks the programs of the packages in FOLDER into TO, installs with apt the libraries that
# they miss here, and nothing else: no service, no settings.
take_packages() {
  local folder=$1 to=$2 package newest depends=()
  rm -rf "$to" && mkdir -p "$to" || return
  for package in telefab telefab-scan telefab-fab; do
    # shellcheck disable=SC2012  # of names that dpkg made
    newest=$(ls -t "$folder/${package}_"*.deb 2>/dev/null | head -n 1)
    [ -n "$newest" ] || { echo "there is no $package package in $folder; deploy/release makes it" >&2; return 1; }
    dpkg-deb -x "$newest" "$to" || return
    depends+=("$(dpkg-deb -f "$newest" Depends)")
  done
  if ldd "$to"/usr/bin/telefab* | grep 'not found'; then
    as_root apt-get update && as_root env DEBIAN_FRONTEND=noninteractive apt-get satisfy -y --no-install-recommends "${depends[@]}"
  fi
}
