#!/usr/bin/env bash
# Sets up what the targets of the Makefile need. Each step is safe to repeat.
#
#   tools/setup.sh python    .venv with the locked dependencies and the project itself (editable)
#   tools/setup.sh opengl    a driver that gives an OpenGL 4.5 context through EGL
#   tools/setup.sh lock      write requirements.lock anew from pyproject.toml (UPGRADE=1: newest versions)
#
# PYTHON names the interpreter to build .venv with. As root on Debian or Ubuntu, missing system packages are
# installed; anywhere else one line says which they are.
set -eu
cd "$(dirname "$0")/.."

VENV=.venv
OPENGL_PACKAGES=(libegl1 libgl1 libgl1-mesa-dri)   # the two libraries that glcontext opens, and Mesa's software driver

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

# require_packages REASON PACKAGE...: install system packages where that is possible, or name them.
require_packages() {
    local reason=$1; shift
    command -v apt-get >/dev/null || fail "$reason. Install your system's counterparts of: $*"
    [ "$(id -u)" = 0 ] || fail "$reason. Install: sudo apt-get install $*   and run make again."
    say "$reason: installing $*"
    apt-get update -qq || say "apt-get update failed; going on with the package lists that are there"
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq -o Dpkg::Use-Pty=0 --no-install-recommends "$@" </dev/null >/dev/null ||
        fail "apt-get could not install $*; its message is above."
}

is_recent() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

find_python() {
    local candidate found
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
        if is_recent "$candidate"; then echo "$candidate"; return; fi
    done
    found=$({ "${PYTHON:-python3}" --version || echo absent; } 2>/dev/null)
    fail "Python 3.11 or newer is needed, and ${PYTHON:-python3} is $found. Install one" \
        "(Ubuntu 22.04: apt-get install python3.11 python3.11-venv) or name one: make PYTHON=/path/to/python3.11"
}

create_environment() {
    if is_recent "$VENV/bin/python" && "$VENV/bin/python" -m pip --version >/dev/null 2>&1; then return; fi
    local python version
    python=$(find_python)
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    "$python" -c 'import ensurepip, venv' 2>/dev/null ||
        require_packages "$python cannot make virtual environments" "python$version-venv"
    say "creating $VENV with Python $version"
    "$python" -m venv --clear "$VENV"
}

setup_python() {
    create_environment
    say "installing the locked dependencies (1.5 GB on disk; a minute or more the first time)"
    "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
    "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
}

# The last line of what happened: the renderer's name, or why there is no context.
try_opengl() {
    "$VENV/bin/python" 2>&1 <<'PYTHON' | tail -n 1
from isosample.errors import OpenGLError
from isosample.gl.context import create_context

try:
    print("OpenGL by", create_context().info["GL_RENDERER"])
except OpenGLError as error:
    print(error.__cause__)
PYTHON
}

setup_opengl() {
    local outcome
    outcome=$(try_opengl)
    case $outcome in "OpenGL by "*) say "$outcome"; return ;; esac
    require_packages "no OpenGL 4.5 context ($outcome)" "${OPENGL_PACKAGES[@]}"
    outcome=$(try_opengl)
    case $outcome in "OpenGL by "*) say "$outcome" ;; *) fail "still no OpenGL 4.5 context: $outcome" ;; esac
}

lock() {
    local scratch
    scratch=$(mktemp -d)
    # shellcheck disable=SC2064  # expanded now: `scratch` is local
    trap "rm -rf '$scratch'" EXIT
    "$(find_python)" -m venv "$scratch"
    "$scratch/bin/python" -m pip install --quiet --disable-pip-version-check uv
    "$scratch/bin/uv" pip compile --quiet --universal --python-version 3.11 --fork-strategy fewest --generate-hashes \
        --extra all --group dev --group build --custom-compile-command "make lock" ${UPGRADE:+--upgrade} \
        --output-file requirements.lock pyproject.toml
}

case ${1:-} in
    python) setup_python ;;
    opengl) setup_opengl ;;
    lock) lock ;;
    *) fail "usage: tools/setup.sh python|opengl|lock" ;;
esac
