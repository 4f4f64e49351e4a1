#!/usr/bin/env bash
# The part of check.sh that runs in the booted system: packages in /packages, of their next version
# in /packages/next. It changes the system for good; run it in one that is thrown away.
set -euo pipefail
cd /packages

step() { printf '\n\033[1m== %s\033[0m (%d s)\n' "$*" "$SECONDS"; }
wrong() { echo "WRONG: $*" >&2; journalctl --no-pager -u maneuverd -n 30 >&2 || true; exit 1; }
# same WHAT EXPECTED ACTUAL
same() { [ "$2" = "$3" ] || wrong "$1: expected '$2', got '$3'"; echo "$1: $3"; }
holds() { local what=$1; shift; "$@" >/dev/null 2>&1 || wrong "$what"; echo "$what: yes"; }
fails() { local what=$1; shift; ! "$@" >/dev/null 2>&1 || wrong "$what"; echo "$what: no, as it should be"; }
apt_get() { apt-get --yes --quiet --no-install-recommends "$@" >apt.log 2>&1 || { tail -n 30 apt.log >&2; wrong "apt-get $*"; }; }
server() { systemctl show --property MainPID --value maneuverd; }
field() { sed -n "s/^$2:[[:space:]]*//p" "/proc/$1/status"; }
wait_until() { for _ in $(seq 1000); do "$@" >/dev/null 2>&1 && return; sleep 0.2; done; wrong "never: $*"; }

step "Server and command are installed, and it runs"
apt_get install ./maneuverd_*.deb ./maneuver_*.deb
wait_until maneuver health
same "user" maneuver "$(ps -o user= -p "$(server)")"
same "enabled" enabled "$(systemctl is-enabled maneuverd)"
holds "maneuverd health asks by the configuration" maneuverd health --config /etc/maneuver/maneuverd.conf

step "Its hardening, as the unit says and as the process has it"
systemd-analyze verify maneuverd.service
systemd-analyze security --no-pager maneuverd.service | tail -n 1
holds "exposure below 2.0" systemd-analyze security --threshold=20 maneuverd.service
pid=$(server)
for kind in CapInh CapPrm CapEff CapBnd CapAmb; do
  same "$kind" 0000000000000000 "$(field "$pid" $kind)"
done
same "no new privileges" 1 "$(field "$pid" NoNewPrivs)"
same "filtered system calls" 2 "$(field "$pid" Seccomp)"
same "restarted after a crash" on-failure "$(systemctl show -p Restart --value maneuverd)"
limit=$(systemctl show -p MemoryMax --value maneuverd)
[ "$limit" -gt 0 ] 2>/dev/null || wrong "memory limit: $limit"
echo "memory limit: $((limit >> 20)) MiB of $(($(sed -n 's/^MemTotal: *\([0-9]*\).*/\1/p' /proc/meminfo) >> 10)) MiB"
# As its user, where it sees the files as it does.
as_server() { nsenter --target "$pid" --mount setpriv --reuid maneuver --regid maneuver --clear-groups "$@"; }
holds "can write its state" as_server touch /var/lib/maneuver/probe
rm /var/lib/maneuver/probe
in_its_view() { nsenter --target "$pid" --mount "$@"; }
for place in /etc /etc/maneuver /usr/bin /var /var/log /opt; do
  fails "even root may write $place where it runs" in_its_view touch "$place/probe"
done
touch /tmp/elsewhere
fails "sees the /tmp of others" in_its_view test -e /tmp/elsewhere

step "Training, in a process of its own"
apt_get install ./maneuver-trainer_*.deb
maneuver synthesize town --recordings 60 --seed 1 >/dev/null
maneuver synthesize unseen --recordings 4 --seed 2 >/dev/null
maneuver dataset upload town town >/dev/null
train() { maneuver train town --dataset town --settings small_training.json --detach "$@" >/dev/null; }
train
wait_until pgrep -x maneuver-traine
trainer=$(pgrep -x maneuver-traine)
same "user" maneuver "$(ps -o user= -p "$trainer")"
# ps shows no niceness beside SCHED_IDLE.
same "niceness" 19 "$(cut -d ' ' -f 19 "/proc/$trainer/stat")"
same "scheduling class" IDL "$(ps -o cls= -p "$trainer" | tr -d ' ')"
same "rather killed than the server" 500 "$(cat "/proc/$trainer/oom_score_adj")"
same "capabilities" 0000000000000000 "$(field "$trainer" CapEff)"
wait_until maneuver health maneuver.v1.PredictionService
scene=$(maneuver scenario list unseen --output json | sed -n 's/.*"scenario_\{0,1\}[iI]d": *"\([^"]*\)".*/\1/p' | head -n 1)
maneuver scenario extract unseen "$scene" --out scene.json
maneuver probability scene.json | tail -n 3
holds "two ranks learn together" maneuver train pair --dataset town --settings small_training.json --ranks 2 --promote never
maneuver model delete pair/1 >/dev/null

step "A ten-line program, by CMake and by pkg-config"
apt_get install cmake g++ make pkg-config ./libmaneuver-client-dev_*.deb
cmake -S program -B program/build >program/log && cmake --build program/build >>program/log
same "built by CMake, it lists" models/town/versions/1 "$(program/build/program 127.0.0.1:8470)"
c++ -std=c++20 program/main.cc $(pkg-config --cflags --libs maneuver-client) -o program/by-pkg-config
same "built by pkg-config, it lists" models/town/versions/1 "$(program/by-pkg-config 127.0.0.1:8470)"

step "A program in Python"
apt_get install ./python3-maneuver_*.deb
holds "its modules are compiled" sh -c 'ls /usr/lib/python3/dist-packages/maneuver/__pycache__/client.*.pyc'
same "it lists" models/town/versions/1 "$(python3 -c '
import maneuver
print(*(version.name for version in maneuver.Client().list_model_versions()))')"
apt_get remove python3-maneuver
fails "anything of it is left" test -e /usr/lib/python3/dist-packages/maneuver

step "Upgrade, while it is asked and while it trains"
echo '# a line of an administrator' >>/etc/maneuver/maneuverd.conf
asked() {
  while [ ! -e stop ]; do
    if maneuver probability scene.json >/dev/null 2>>asked.log; then echo ok; else echo failed; fi
  done
}
train --epochs 12
wait_until pgrep -x maneuver-traine
asked >asked.txt &
before=$(server)
apt_get install -o Dpkg::Options::=--force-confdef ./next/*.deb
wait_until maneuver health
touch stop && wait
[ "$before" != "$(server)" ] || wrong "the server was not restarted"
holds "it drained, by its log" sh -c "journalctl -u maneuverd _PID=$before | grep -q stopped"
fails "killed for want of time" sh -c "journalctl -u maneuverd | grep -Eq 'SIGKILL|timed out'"
holds "calls were answered meanwhile" grep -q ok asked.txt
# One server alone is away for a moment; what is in flight is answered, and who comes then is told so.
echo "calls: $(grep -c ok asked.txt) answered, $(grep -c failed asked.txt || true) found nobody listening"
same "calls that failed otherwise" 0 "$(grep -vc 'no server answers' asked.log || true)"
same "version" "$(dpkg-deb -f next/maneuverd_*.deb Version)" "$(dpkg-query -W -f '${Version}' maneuverd)"
holds "the administrator's line is there" grep -q administrator /etc/maneuver/maneuverd.conf
done_training() { maneuver model show town/2; }
wait_until done_training
echo "the job went on: $(maneuver job list | sed -n 2p)"

step "Removal keeps what is dear, and an installation finds it again"
apt_get remove maneuverd
fails "it runs" pgrep -x maneuverd
holds "its state is there" test -f /var/lib/maneuver/maneuver.db
mount --bind /var/lib/maneuver /var/lib/maneuver
sh /var/lib/dpkg/info/maneuverd.postrm purge
umount /var/lib/maneuver
holds "what is on a mounted volume is there even after a purge" test -f /var/lib/maneuver/maneuver.db
holds "its configuration is there" grep -q administrator /etc/maneuver/maneuverd.conf
apt_get install ./next/maneuverd_*.deb
wait_until maneuver health maneuver.v1.PredictionService
same "models" 2 "$(program/build/program 127.0.0.1:8470 | wc -l)"

step "Purging asks nothing and leaves nothing but what others put there"
install -m 640 -g maneuver /dev/null /etc/maneuver/tokens
apt_get purge maneuverd maneuver-trainer </dev/null
fails "it runs" pgrep -x maneuverd
fails "its state is there" test -e /var/lib/maneuver
fails "its configuration is there" test -e /etc/maneuver/maneuverd.conf
holds "the administrator's file is there" test -f /etc/maneuver/tokens
fails "the unit is there" systemctl cat maneuverd.service
same "links that systemd knows it by" "" "$(find /etc/systemd -name '*maneuver*')"
