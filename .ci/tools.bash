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

# A Python of its own, where pip may install without touching the machine's.
make_venv() { # FOLDER
    python3 -m venv "$1" 2>/dev/null || {
        rm -rf "$1"
        apt-get update -qq && apt-get install -y -qq --no-install-recommends python3-venv >/dev/null
        python3 -m venv "$1"
    }
}

# The Python package as a wheel, which `$scratch/venv` gets with these extras and packages. Building leaves files next to the
# source: it is a copy.
install_wheel() { # EXTRAS, PACKAGE...
    local pip=("$scratch/venv/bin/pip" --disable-pip-version-check --quiet) extras=$1
    shift
    cp -r clients/python "$scratch/python"
    "${pip[@]}" wheel --no-deps --wheel-dir "$scratch/wheel" "$scratch/python"
    "${pip[@]}" install --no-compile "$(echo "$scratch"/wheel/equipoise-*.whl)[$extras]" "$@"
}
