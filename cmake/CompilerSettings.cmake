# Interface targets for our own code only; dependencies never see them.

add_library(farol_settings INTERFACE)
target_compile_options(farol_settings INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
  -Wnon-virtual-dtor -Wold-style-cast -Wcast-align -Woverloaded-virtual -Wdouble-promotion)
if(FAROL_WARNINGS_AS_ERRORS)
  target_compile_options(farol_settings INTERFACE -Werror)
endif()
if(FAROL_SANITIZE)
  target_compile_options(farol_settings INTERFACE
    -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(farol_settings INTERFACE -fsanitize=address,undefined)
  if(CMAKE_CXX_COMPILER_ID MATCHES Clang)  # tests/fuzz
    target_compile_options(farol_settings INTERFACE -fsanitize=fuzzer-no-link)
  endif()
endif()
if(FAROL_SANITIZE_THREADS)
  target_compile_options(farol_settings INTERFACE -fsanitize=thread -fno-omit-frame-pointer)
  target_link_options(farol_settings INTERFACE -fsanitize=thread)
endif()

# Headers of libraries that most sources include are read once. Off in the asan preset, where sources must include what they use.
option(FAROL_PRECOMPILED_HEADERS "Precompile headers of libraries" ON)
if(NOT FAROL_PRECOMPILED_HEADERS)
  set(CMAKE_DISABLE_PRECOMPILE_HEADERS ON)
endif()
add_compile_options(-pthread)  # some libraries ask for it, and all targets share the headers
set(FAROL_COMMON_HEADERS <algorithm> <array> <functional> <map> <memory> <optional> <span> <string> <vector> <fmt/format.h> <glm/glm.hpp>)

find_program(CCACHE ccache)
if(CCACHE)  # with what it needs to know precompiled headers
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros ${CCACHE})
  if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
    add_compile_options(-fpch-preprocess)
  endif()
endif()

# farol_room(name SOURCES ... USES ... [PRIVATE_USES ...])
# One room of src/ as a static library: USES is what its headers show, PRIVATE_USES what stays inside.
function(farol_room name)
  cmake_parse_arguments(ROOM "" "" "SOURCES;USES;PRIVATE_USES" ${ARGN})
  add_library(farol_${name} STATIC ${ROOM_SOURCES})
  target_include_directories(farol_${name} PUBLIC ${CMAKE_SOURCE_DIR}/src)
  target_link_libraries(farol_${name} PUBLIC ${ROOM_USES} PRIVATE farol_settings ${ROOM_PRIVATE_USES})
  if(name STREQUAL base)
    target_precompile_headers(farol_base PRIVATE ${FAROL_COMMON_HEADERS})
  else()
    target_precompile_headers(farol_${name} REUSE_FROM farol_base)
  endif()
endfunction()
