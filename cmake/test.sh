#!/bin/sh
# Checks the sources' format, builds with warnings as errors and runs every quick test, as continuous integration does: closed
# forms, GPU, bad input, the program itself, valid shaders, the unit tests under AddressSanitizer and UBSan, and the fuzzers for
# 20 seconds.
# Installs missing Debian packages first (with sudo unless root).
set -e
cd "$(dirname "$0")/.."
. cmake/packages.sh
find src shaders tests -name '*.cpp' -o -name '*.h' | xargs clang-format --dry-run --Werror
echo "format: clean"
cmake --preset ci
cmake --build --preset ci
for shader in build/ci/shaders/*.spv; do
  spirv-val --target-env vulkan1.3 "$shader"
done
echo "shaders: $(ls build/ci/shaders/*.spv | wc -l) valid"
ctest --preset ci

cmake --preset asan
cmake --build --preset asan --target farol_unit_tests farol farol_scene_fuzz farol_factors_fuzz
ctest --preset asan -L unit
# The whole program under the sanitizers, on the software device; leaks of drivers are not ours.
ASAN_OPTIONS=detect_leaks=0 FAROL_VALIDATION=1 build/asan/src/farol render scenes/cornell_box/cornell_box.gltf \
  -o build/asan/sanitized.png --size 64x64 --patches 100 --quiet
echo "sanitizers: clean"
sh cmake/fuzz.sh 20
