# shellcheck shell=bash
# Sourced by .ci/systemd: checks of the sensors' units, and of the daemon without a network.

# The daemon has a network of its own with nothing in it, and no socket but Unix sockets.
check_network_of_daemon() {
    local pid sockets inode unix table others
    pid=$(main_pid equipoise)
    [[ $(inside readlink "/proc/$pid/ns/net") != "$(inside readlink /proc/1/ns/net)" ]] || fail "the daemon is in the PC's network"
    others=$(inside cat "/proc/$pid/net/dev" | sed -n 's/^ *\([^ :]*\):.*/\1/p' | grep -vx lo || true)
    [[ -z $others ]] || fail "the daemon's network has the interfaces $others"
    for table in tcp tcp6 udp udp6 raw raw6; do
        others=$(inside cat "/proc/$pid/net/$table" 2>/dev/null | tail -n +2)
        [[ -z $others ]] || fail "the daemon's network has sockets of $table: $others"
    done
    unix=" $(inside cat "/proc/$pid/net/unix" | awk 'NR > 1 { print $7 }' | xargs) "
    # Of systemd's notification socket and of the journal's streams the other end lies in the PC's network.
    unix+="$(inside cat /proc/1/net/unix | awk 'NR > 1 { print $7 }' | xargs) "
    sockets=$(inside bash -c "readlink /proc/$pid/fd/*" | sed -n 's/^socket:\[\([0-9]*\)\]$/\1/p')
    for inode in $sockets; do
        [[ $unix == *" $inode "* ]] || fail "the daemon has a socket ($inode) that is no Unix socket"
    done
    holds "the daemon (process $pid) has a network of its own with no address, and $(wc -w <<<"$sockets") sockets, all Unix sockets"
}

# Sensors run without capabilities and without sight of profiles; in real time where systemd may raise limits.
check_rights_of_sensors() {
    local stream pid seen scheduled
    for stream in suit ground; do
        pid=$(main_pid "equipoise-adapter@$stream")
        for seen in CapBnd CapEff CapAmb; do
            inside cat "/proc/$pid/status" | grep -q "^$seen:[[:space:]]*0*$" || fail "the adapter $stream has capabilities ($seen)"
        done
        seen=$(inside nsenter -t "$pid" -m ls -A /var/lib/equipoise) || fail "what the adapter sees cannot be seen"
        [[ -z $seen ]] || fail "the adapter $stream sees of /var/lib/equipoise: $seen"
        scheduled=$(inside cat "/proc/$pid/stat" | sed 's/.*) //' | awk '{ print $39 ":" $38 }')
        if [[ $raises_limits == yes ]]; then
            [[ $scheduled == 1:75 ]] || fail "the adapter $stream is scheduled by policy:priority $scheduled"
            holds "the adapter $stream (process $pid) has SCHED_FIFO 75 by its limit alone, no capability, and sees no profile"
        else
            journal_has "equipoise-adapter@$stream" "asked for SCHED_FIFO 75" || fail "the adapter $stream does not say that it lacks real time"
            holds "the adapter $stream (process $pid) has no capability and sees no profile"
            echo "systemd: NOT CHECKED: the adapter's SCHED_FIFO; here systemd lacks CAP_SYS_RESOURCE and cannot grant LimitRTPRIO="
        fi
    done
}

active_incidents() { ask '["incidents"]["active"]'; }

# A sensor's unit that is killed, stopped or reloaded: the daemon goes on, says so, and the sensor is back.
check_deaths_of_sensors() {
    local daemon stream killed unit
    daemon=$(main_pid equipoise)
    for stream in suit ground; do
        unit=equipoise-adapter@$stream
        killed=$(main_pid "$unit")
        inside bash -c "kill -KILL $killed"
        replaced() { [[ $(main_pid "$unit") != "$killed" && $(main_pid "$unit") != 0 ]] && is "$unit" ActiveState active; }
        until_so "another $unit" replaced
        sensors_fresh() {
            local age
            for age in suit_age_ns ground_age_ns; do
                (($(ask "[\"state\"][\"$age\"] or 10**10" || echo 10000000000) < 200000000)) || return 1
            done
        }
        until_so "the sensors after the death of $unit" sensors_fresh
        [[ $(main_pid equipoise) == "$daemon" ]] || fail "the daemon did not survive the death of $unit"
        holds "killed, $unit is back as process $(main_pid "$unit"), and its sensor with it; the daemon goes on as process $daemon"

        inside systemctl stop "$unit"
        named() { grep -q "journalctl -u $unit" <<<"$(active_incidents)"; }
        until_so "an incident that names $unit" named
        holds "stopped, $unit is reported: $(ask '["daemon"]["incidents"]' | grep -o "'${stream}_adapter_down': .[^']*")"
        inside systemctl start "$unit"
        until_so "the sensors after the start of $unit" sensors_fresh
        ended() { ! named; }
        until_so "the end of the incident" ended

        killed=$(main_pid "$unit")
        inside systemctl reload "$unit"
        reread() { journal_has "$unit" "the configuration is read again"; }
        until_so "$unit to read the configuration again" reread
        until_so "the sensors after the reload of $unit" sensors_fresh
        [[ $(main_pid "$unit") == "$killed" ]] || fail "reload ended $unit"
        holds "reloaded, $unit reopens its sensor as the same process"
    done
}
