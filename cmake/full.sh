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
tbb="$(sh cmake/tsan_tbb.sh)"
# The libraries that are not built for it are named in the file of suppressions.
watched() { TSAN_OPTIONS="suppressions=$(pwd)/tests/data/tsan.supp" LD_LIBRARY_PATH="$tbb" "$@"; }
watched build/tsan/tests/unit/farol_unit_tests
FAROL_RANDOM_SCENES=10 watched build/tsan/tests/random/farol_random_tests
cornell=scenes/cornell_box/cornell_box.gltf
watched build/tsan/src/farol solve $cornell --patches 300 --method rays --patches-csv build/tsan/p.csv --quiet
watched build/tsan/src/farol render $cornell --patches 1500 --method raster --solve-on gpu -o build/tsan/p.png --size 64x64 --quiet
echo "threads: clean"
for check in SYNCHRONIZATION_VALIDATION GPU_ASSISTED; do
  VK_LAYER_ENABLES=VK_VALIDATION_FEATURE_ENABLE_${check}_EXT FAROL_VALIDATION=1 \
    build/ci/src/farol render $cornell -o build/ci/checked.png --size 64x64 --patches 200 --method raster --solve-on gpu --quiet
  echo "$check: clean"
done
git ls-files "src/*.cpp" | xargs -P "$(nproc)" -n 2 clang-tidy -p build/asan --quiet
sh cmake/fuzz.sh "${FAROL_FUZZ_SECONDS:-600}"
