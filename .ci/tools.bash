# shellcheck shell=bash
# Sourced by every check that needs more than a Rust toolchain.

need_packages() { # command, Debian packages...
    local command=$1
    shift
    command -v "$command" >/dev/null && return
    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# What cannot be had here is said, and skipped; under CI=true it must be had, so there it is a failure.
skipped() { # stage, reason
    echo "$1: skipped: $2" >&2
    [[ ${CI:-} != true ]]
}
