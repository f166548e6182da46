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

find_program(CCACHE ccache)
if(CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CCACHE})
endif()

# farol_room(name SOURCES ... USES ... [PRIVATE_USES ...])
# One room of src/ as a static library: USES is what its headers show, PRIVATE_USES what stays inside.
function(farol_room name)
  cmake_parse_arguments(ROOM "" "" "SOURCES;USES;PRIVATE_USES" ${ARGN})
  add_library(farol_${name} STATIC ${ROOM_SOURCES})
  target_include_directories(farol_${name} PUBLIC ${CMAKE_SOURCE_DIR}/src)
  target_link_libraries(farol_${name} PUBLIC ${ROOM_USES} PRIVATE farol_settings ${ROOM_PRIVATE_USES})
endfunction()
