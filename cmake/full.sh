#!/bin/sh
# Everything: the quick tests, every test under the sanitizers, clang-tidy over all sources.
set -e
cd "$(dirname "$0")/.."
farol_more_packages="clang-tidy"
. cmake/packages.sh
sh cmake/test.sh
cmake --build --preset asan
ASAN_OPTIONS=detect_leaks=0 ctest --preset asan
git ls-files "src/*.cpp" | xargs -P "$(nproc)" -n 2 clang-tidy -p build/ci --quiet
