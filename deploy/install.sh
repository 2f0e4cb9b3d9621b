#!/bin/sh
# Installs hri-predict from this folder alone; nothing is fetched from a network.
#   ./install.sh /opt/hri-predict          (PYTHON=python3.12 ./install.sh … names another Python)
set -eu
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
target=${1:-}
python=${PYTHON:-python3}
if [ -z "$target" ]; then
    echo "error: name the folder to install into, such as /opt/hri-predict" >&2
    exit 2
fi
needs=$(cat "$here/python-version")
has=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
if [ "$has" != "$needs" ]; then
    echo "error: the bundle is for Python $needs and $python is $has; set PYTHON=python$needs" >&2
    exit 2
fi
"$python" -m venv "$target"
"$target/bin/python" -m pip install --quiet --disable-pip-version-check --no-index \
    --find-links "$here/wheels" --require-hashes -r "$here/requirements.txt"
"$target/bin/hri-predict" --version
