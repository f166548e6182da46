#!/bin/sh
# Everything: the quick tests, a thousand random scenes, every test under AddressSanitizer and UBSan, the program and its
# unit tests under ThreadSanitizer, Vulkan's own synchronization checks, clang-tidy over all sources, and the fuzzers for
# ten minutes each (or FAROL_FUZZ_SECONDS).
set -e
cd "$(dirname "$0")/.."
farol_more_packages="clang-tidy"
. cmake/packages.sh
sh cmake/test.sh
FAROL_RANDOM_SCENES=1000 build/ci/tests/random/farol_random_tests
cmake --build --preset asan
ASAN_OPTIONS=detect_leaks=0 ctest --preset asan
cmake --preset tsan
cmake --build --preset tsan --target farol_unit_tests farol farol_random_tests
# Embree and TBB are not built for it: what they hide is named in the file of suppressions.
export TSAN_OPTIONS="suppressions=$(pwd)/tests/data/tsan.supp"
build/tsan/tests/unit/farol_unit_tests
FAROL_RANDOM_SCENES=10 build/tsan/tests/random/farol_random_tests
build/tsan/src/farol solve scenes/cornell_box/cornell_box.gltf --patches 300 --method rays --patches-csv build/tsan/p.csv --quiet
echo "threads: clean"
VK_LAYER_ENABLES=VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT FAROL_VALIDATION=1 \
  build/ci/src/farol render scenes/cornell_box/cornell_box.gltf -o build/ci/synchronized.png --size 64x64 --patches 200 --method raster --solve-on gpu --quiet
echo "synchronization: clean"
git ls-files "src/*.cpp" | xargs -P "$(nproc)" -n 2 clang-tidy -p build/ci --quiet
sh cmake/fuzz.sh "${FAROL_FUZZ_SECONDS:-600}"
