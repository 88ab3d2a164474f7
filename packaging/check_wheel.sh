#!/bin/sh
# Installs a wheel where there is no compiler and no checkout, and runs it: packaging/check_wheel.sh WHEEL [PYTHON]
set -eu
wheel=$(realpath "$1")
python=$(command -v "${2:-python3}")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$python" -m venv "$folder/venv"
cd "$folder"
# A path without compilers: an installation that would compile anything fails.
mkdir bin
for tool in sh env uname ls rm mkdir cat grep sed head; do ln -s "$(command -v $tool)" bin/$tool; done
export PATH="$folder/venv/bin:$folder/bin" CC=/none CXX=/none
if command -v c++ || command -v g++ || command -v cc || command -v cmake; then
  echo "there is a compiler on the path; the check would show nothing" >&2
  exit 1
fi
pip install --quiet --only-binary :all: "$wheel[sweep]"
rig --version
rig simulate corner --tolerance 5 --json > simulate.json
rig run session -p ci-tiny --json > session.json || [ $? -eq 1 ]
cat > study.toml <<'STUDY'
schema = 1
subject = "paper"
[fixed]
width_px = 32
height_px = 24
[grid]
reflectance = [0.3, 0.7]
STUDY
rig sweep study.toml --workers 1 --json > sweep.json
python -c 'import rig; print(rig.sweep("study.toml")[["reflectance", "indirect_mean", "bounded_mean"]])'
echo "the wheel works without a compiler"
