# shellcheck shell=bash
# Sourced by the checks that need the demonstration running. All that is known of its command line stands here.

source .ci/tools.bash

# The binary, as the tests have built it: optimised, with all assertions and checks of overflow. There is nothing to build
# after that stage.
equipoise=${EQUIPOISE:-${CARGO_TARGET_DIR:-target}/debug/equipoise}
demo_seconds=${DEMO_SECONDS:-240}
demo_station=demo

# Commands, not functions: a function in the background is a shell whose end leaves its command behind.
demo_headless=("$equipoise" demo --once --headless --json --duration "$demo_seconds")
demo_with_cobot=("${demo_headless[@]}" --cobot --station demo-cobot)
demo_with_page=("$equipoise" demo --once --duration "$demo_seconds" --page) # and an address
record_demo=("$equipoise" record --station "$demo_station")          # and a file

scratch=$(mktemp -d)
# A bus of its own: no other process of this machine takes part, nothing is left behind. Short, for sockets lie in it.
export EQUIPOISE_BUS_ROOT=$scratch/bus
started=()

# How the names of that bus's shared memory begin (`bus/src/root.rs`): what is killed cannot remove its own.
shared_memory_prefix() { # root
    local hash=$((0x811c9dc5)) at byte
    for ((at = 0; at < ${#1}; at++)); do
        printf -v byte %d "'${1:at:1}"
        hash=$((((hash ^ byte) * 0x01000193) & 0xffffffff))
    done
    printf 'eqp_%08x_' "$hash"
}

end_started() {
    local process
    for process in "${started[@]}"; do
        kill -TERM "$process" 2>/dev/null || true
        wait "$process" 2>/dev/null || true
    done
    rm -f "/dev/shm/$(shared_memory_prefix "$EQUIPOISE_BUS_ROOT")"*
    rm -rf "$scratch"
}
trap end_started EXIT

# Never a binary of yesterday: cargo looks whether there is anything to do.
if [[ -z ${EQUIPOISE:-} ]]; then
    cargo build --quiet --workspace --bin equipoise
fi

# A free loopback port below the kernel's ephemeral range, so that no other process gets it by chance before it is used.
free_port() { # SOCK_STREAM or SOCK_DGRAM
    python3 - "$1" <<'PY'
import random, socket, sys

while True:
    port = random.randrange(20000, 30000)
    with socket.socket(type=getattr(socket, sys.argv[1])) as one:
        try:
            one.bind(("127.0.0.1", port))
        except OSError:
            continue
    print(port)
    break
PY
}

# The program of a gateway that depends on a big library, as built by `cargo test --workspace`: there is nothing to build
# after that stage. The test is one of the gateway's own, whose build includes the program; `cargo build -p` would rebuild
# third-party crates with other features.
gateway_program() { # KIND, TEST
    cargo test --quiet --workspace --test "$2" --no-run >&2
    echo "${CARGO_TARGET_DIR:-target}/debug/equipoise-gateway-$1"
}
