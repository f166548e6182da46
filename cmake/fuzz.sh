#!/bin/sh
# Fuzzes the scene loader and the reader of kept factors for so many seconds each, from the seeds in tests/data/fuzz, with
# the targets of the asan preset. What they find stays in build/asan/fuzz; what the code under test says (it warns of every
# input) goes nowhere: -close_fd_mask.
set -e
cd "$(dirname "$0")/.."
seconds=${1:-20}
for target in scene factors; do
  mkdir -p "build/asan/fuzz/$target"
  log="build/asan/fuzz/$target.log"
  if ! "build/asan/tests/fuzz/farol_${target}_fuzz" -close_fd_mask=2 -max_total_time="$seconds" -max_len=20000 -timeout=20 \
    -rss_limit_mb=4000 -dict=tests/data/fuzz/gltf.dict -print_final_stats=1 -artifact_prefix="build/asan/fuzz/${target}_" \
    "build/asan/fuzz/$target" "tests/data/fuzz/$target" > "$log" 2>&1; then
    tail -40 "$log"
    exit 1
  fi
  echo "fuzz $target: $(grep number_of_executed_units "$log" | sed 's/.*: *//') inputs, $(grep -o 'cov: [0-9]*' "$log" | tail -1)"
done
