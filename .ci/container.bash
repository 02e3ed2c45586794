# shellcheck shell=bash
# Sourced by the checks that boot a Debian of their own as a container, after setting `stage`. `$root` is its file system,
# which the check may change before `boot`; inside, the container has a loopback of its own. Nothing of this machine is
# started, stopped or changed.
#
# Needs root, and once the network, for the Debian (kept in the user's private cache).
source .ci/tools.bash

mirror=${DEBIAN_MIRROR:-http://deb.debian.org/debian}
nspawn=(systemd-nspawn --register=no --keep-unit -q --private-network)

cannot() { # reason
    skipped "$stage" "$1" || exit 1
    exit 0
}

((EUID == 0)) || cannot "a container needs root"
while read -r tool package; do
    need_packages "$tool" "$package" </dev/null || cannot "$tool cannot be installed"
done <<TOOLS
debootstrap debootstrap
systemd-nspawn systemd-container
nsenter util-linux
pgrep procps
python3 python3-minimal
TOOLS

# --- a Debian of the same release as this one, if this is one: its C library is then the one the program was built with.
release=$(. /etc/os-release && [[ $ID == debian ]] && echo "${VERSION_CODENAME:-}" || true)
release=${release:-bookworm}
# All of it runs as root later, so it must be in a folder that no other user can write to.
cache=${XDG_CACHE_HOME:-${HOME:?}/.cache}/equipoise-ci
mkdir -p "$(dirname "$cache")"
[[ -e $cache || -L $cache ]] || mkdir -m 0700 "$cache"
if [[ -L $cache || ! -d $cache || ! -O $cache ]]; then
    echo "$stage: $cache is not a directory of this user: remove it, or set XDG_CACHE_HOME" >&2
    exit 1
fi
chmod 0700 "$cache"
# Consumers in Python run inside.
kept=${EQUIPOISE_DEBIAN:-$cache/debian-$release-python3}
if [[ -e $kept && (-L $kept || ! -O $kept) ]]; then
    echo "$stage: $kept is not a directory of this user: remove it" >&2
    exit 1
fi
if [[ ! -d $kept ]]; then
    echo "$stage: making a Debian $release in $kept"
    rm -rf "$kept.part"
    debootstrap --variant=minbase --include=systemd,systemd-sysv,dbus,python3 "$release" "$kept.part" "$mirror" \
        >"$kept.log" 2>&1 || { tail -3 "$kept.log"; rm -rf "$kept.part"; cannot "debootstrap failed"; }
    mv "$kept.part" "$kept"
fi
scratch=$(mktemp -d)
root=$scratch/root
container= leader= receiver=
finish() {
    [[ -z $receiver ]] || kill "$receiver" 2>/dev/null || true
    # With its first process all others of the container end; nspawn then clears away what it mounted.
    if [[ -n $container ]]; then
        pkill -KILL -P "$container" || kill -KILL "$container" 2>/dev/null || true
        wait "$container" 2>/dev/null || true
    fi
    rm -rf "$scratch"
}
trap finish EXIT
trap 'exit 1' INT TERM
trap 'echo "$stage: line $LINENO failed: $BASH_COMMAND" >&2' ERR
cp -a --reflink=auto "$kept" "$root"
"${nspawn[@]}" --capability=CAP_IPC_LOCK -D "$root" /bin/true \
    >"$scratch/nspawn.log" 2>&1 || { cat "$scratch/nspawn.log"; cannot "systemd-nspawn cannot run here"; }

test_unit() { # name, user, command
    cat >"$root/etc/systemd/system/$1.service" <<UNIT
[Service]
User=$2
Environment=EQUIPOISE_BUS_ROOT=/run/equipoise/iceoryx2
ExecStart=$3
StandardOutput=append:/run/$1.out
UNIT
}

patience=60
inside() { nsenter -t "$leader" -m -u -i -n -p -- "$@"; }
fail() { # what
    echo "$stage: FAILED: $1" >&2
    if [[ -n $leader ]]; then
        inside journalctl --no-pager -q -n 60 -o short-monotonic >&2 || true
    fi
    exit 1
}
holds() { echo "$stage: ok: $1"; }
until_so() { # what, command...
    local what=$1 begun=$SECONDS
    shift
    until "$@"; do
        ((SECONDS - begun < patience)) || fail "waited in vain for $what"
        sleep 0.1
    done
}
of() { inside systemctl show --value -p "$2" "$1"; } # unit, property
is() { [[ $(of "$1" "$2") == "$3" ]]; }               # unit, property, value
main_pid() { of "$1" MainPID; }
journal_of() { inside journalctl -q --no-pager -o cat -u "$1"; }
journal_has() { grep -q -- "$2" <<<"$(journal_of "$1")"; } # unit, text
as_service() { inside runuser -u equipoise -- env EQUIPOISE_BUS_ROOT=/run/equipoise/iceoryx2 "$@"; }
ask() { # path in the JSON of the status, as Python writes it
    as_service equipoise status --json 2>/dev/null |
        python3 -c "import json, sys; print(json.load(sys.stdin)$1)" 2>/dev/null
}

# By its name: the first child of nspawn only makes the container, and ends.
has_leader() { leader=$(pgrep -P "$container" -x systemd); }
systemd_answers() { inside systemctl show -p Version >/dev/null 2>&1; }
boot() {
    "${nspawn[@]}" --capability=CAP_IPC_LOCK --link-journal=no -M "equipoise-$$" -D "$root" -b >"$scratch/console.log" 2>&1 &
    container=$!
    until_so "the container" has_leader
    until_so "its systemd" systemd_answers
    holds "$(inside systemctl --version | head -n 1) runs in the container"
}
