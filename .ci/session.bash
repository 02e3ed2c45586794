# shellcheck shell=bash
# Sourced by the checks that look at a session after it, behind `.ci/demo.bash`: a recording of the demonstration in which the
# worker is learnt and has lifted something. A finished one can be looked at by naming it: RECORDING.

session_seconds_max=${SESSION_SECONDS_MAX:-150}

lifts_so_far() {
    "$equipoise" status --station "$demo_station" --json 2>/dev/null |
        python3 -c 'import json, sys; print((json.load(sys.stdin).get("state") or {}).get("lifts", 0))' 2>/dev/null || echo 0
}

record_a_session() { # file
    local recorder begun=$SECONDS
    "${demo_headless[@]}" >/dev/null &
    started+=("$!")
    until "$equipoise" status --station "$demo_station" --json >/dev/null 2>&1; do
        ((SECONDS - begun < 60)) || { echo "session: the demonstration does not start" >&2; return 1; }
        sleep 0.5
    done
    "${record_demo[@]}" "$1" &
    recorder=$!
    started+=("$recorder")
    until (($(lifts_so_far) >= 1)); do
        ((SECONDS - begun < session_seconds_max)) || { echo "session: no lift within $session_seconds_max s" >&2; return 1; }
        kill -0 "$recorder" || { echo "session: equipoise record has ended" >&2; return 1; }
        sleep 1
    done
    kill -INT "$recorder"
    # 3: the machine was too busy and messages were lost; reports and tables tell as much as there is.
    wait "$recorder" || (($? == 3)) || {
        echo "session: equipoise record failed" >&2
        return 1
    }
    echo "session: recorded in $((SECONDS - begun)) s"
}

recording=${RECORDING:-$scratch/session.mcap}
[[ -n ${RECORDING:-} ]] || record_a_session "$recording"
