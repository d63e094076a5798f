# Sourced by the other scripts: a virtual environment in .venv with this package installed.

prepare() { # what to install, such as ".[sim]"
    local python="${PYTHON:-python3}"
    if [ ! -x .venv/bin/python ]; then
        "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
            { echo "Python 3.11 or later is needed; set PYTHON to one" >&2; exit 2; }
        "$python" -m venv .venv
    fi
    source .venv/bin/activate
    # Kernels that are already compiled survive, since the package is installed in place. Python compiles what it imports.
    python -m pip install --no-compile --quiet --disable-pip-version-check --editable "$1"
}
