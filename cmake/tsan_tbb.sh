#!/bin/sh
# Builds TBB with ThreadSanitizer into build/tsan_tbb, from Debian's own source package: without it, TSan cannot see that
# one task waits for another and takes everything for a race. Prints the folder of the library.
set -e
cd "$(dirname "$0")/.."
folder="$(pwd)/build/tsan_tbb"
if [ ! -e "$folder/done" ]; then
  rm -rf "$folder"
  mkdir -p "$folder/apt" "$folder/lists/partial" "$folder/source"
  cp -r /etc/apt/. "$folder/apt"
  for list in "$folder"/apt/sources.list.d/*.sources; do
    [ ! -e "$list" ] || sed -i 's/^Types: deb$/Types: deb deb-src/' "$list"
  done
  for list in "$folder"/apt/sources.list "$folder"/apt/sources.list.d/*.list; do
    [ ! -e "$list" ] || sed -i 's/^deb \(.*\)$/deb \1\ndeb-src \1/' "$list"
  done
  apt="apt-get -q -o Dir::Etc=$folder/apt -o Dir::State::Lists=$folder/lists -o APT::Sandbox::User="
  $apt update >&2
  (cd "$folder/source" && $apt source --download-only onetbb >&2 && tar xf onetbb_*.orig.tar.* --strip-components 1)
  cmake -G Ninja -S "$folder/source" -B "$folder/library" -DTBB_TEST=OFF -DTBB_STRICT=OFF -DTBBMALLOC_BUILD=OFF \
    -DTBB_SANITIZE=thread -DCMAKE_BUILD_TYPE=RelWithDebInfo >&2
  cmake --build "$folder/library" >&2
  touch "$folder/done"
fi
dirname "$(find "$folder/library" -name libtbb.so)"
