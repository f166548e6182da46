# Every dependency, with its role. All are packages of Debian 12; nothing is downloaded.
# A missing one stops the configuration with its name and the package that has it.

find_package(Threads REQUIRED)
find_package(PkgConfig REQUIRED)

macro(farol_require name package role)
  find_package(${name} ${ARGN} QUIET)
  if(NOT ${name}_FOUND)
    message(FATAL_ERROR "farol needs ${name} for ${role}; Debian package: ${package}")
  endif()
endmacro()

farol_require(fmt libfmt-dev "formatted text")
farol_require(nlohmann_json nlohmann-json3-dev "JSON")
farol_require(TinyGLTF libtinygltf-dev "reading glTF")
farol_require(glm libglm-dev "vectors and matrices")
farol_require(CLI11 libcli11-dev "command-line options")
farol_require(Eigen3 libeigen3-dev "dense linear algebra" NO_MODULE)
farol_require(TBB libtbb-dev "threads")
farol_require(ZLIB zlib1g-dev "checksums put together")
# Embree 4 where it is installed, else 3 (Debian 12).
find_package(embree 4 CONFIG QUIET)
if(NOT embree_FOUND)
  farol_require(embree libembree-dev "ray tracing" 3 CONFIG)
endif()
# OpenEXR's CMake package also looks for its Python bindings, which the -dev package does not need; stb has none.
macro(farol_require_module name module package role)
  pkg_check_modules(${name} QUIET IMPORTED_TARGET ${module})
  if(NOT ${name}_FOUND)
    message(FATAL_ERROR "farol needs ${module} for ${role}; Debian package: ${package}")
  endif()
endmacro()
farol_require_module(OPENEXR OpenEXR libopenexr-dev "pictures")
farol_require_module(STB stb libstb-dev "pictures")
farol_require_module(LIBZIP libzip libzip-dev "kept form factors")
farol_require_module(LIBDEFLATE libdeflate libdeflate-dev "their checksums")
farol_require_module(JEMALLOC jemalloc libjemalloc-dev "memory in large pages")

find_path(VOLK_INCLUDE_DIR volk.h)
find_path(VULKAN_INCLUDE_DIR vulkan/vulkan.h)
if(NOT VOLK_INCLUDE_DIR OR NOT VULKAN_INCLUDE_DIR)
  message(FATAL_ERROR "farol needs volk and the Vulkan headers to reach the GPU; "
                      "Debian packages: libvulkan-volk-dev libvulkan-dev")
endif()
find_program(GLSLANG_VALIDATOR glslangValidator)
if(NOT GLSLANG_VALIDATOR)
  message(FATAL_ERROR "farol needs glslangValidator to compile shaders; Debian package: glslang-tools")
endif()

# TinyGLTF's configuration carries no tests for its own dependencies' targets.
if(NOT TARGET glm::glm)
  add_library(glm::glm ALIAS glm)
endif()
