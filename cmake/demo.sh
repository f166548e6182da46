#!/bin/sh
# Builds farol and renders the Cornell box. Installs missing Debian packages first (with sudo unless root).
set -e
cd "$(dirname "$0")/.."
. cmake/packages.sh
cmake --preset release -DFAROL_BUILD_TESTS=OFF > /dev/null
cmake --build --preset release
build/release/src/farol render scenes/cornell_box/cornell_box.gltf -o build/release/cornell_box.png --size 800x800
echo "The picture is $(pwd)/build/release/cornell_box.png"
