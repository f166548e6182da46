#!/bin/sh
# Draws error against time for four of the scenes, a minute each and four for the one of many facets: scenes/*/chart.svg.
# The data beside them are left in build/charts. Run it where nothing else runs.
set -e
cd "$(dirname "$0")/.."
mkdir -p build/charts
for scene in cornell_box/cornell_box.gltf l_room/l_room.gltf reading_corner/reading_corner.glb mirrors_and_glass/mirror_room.gltf; do
  name=$(basename "${scene%.*}")
  seconds=60
  [ "$name" = reading_corner ] && seconds=240
  "${FAROL:-build/ci/src/farol}" chart "scenes/$scene" -o "build/charts/$name.svg" --time "$seconds" > "build/charts/$name.txt"
  cp "build/charts/$name.svg" "scenes/$(dirname "$scene")/chart.svg"
done
