# farol_compile_shaders(target SHADERS name[:DEFINE] ... [FROM folder])
# Compiles <folder>/<name> (shaders/ by default) to SPIR-V for Vulkan 1.3 and embeds it as an array of words:
# hemicube.vert becomes "shaders/hemicube.vert.h" with `hemicube_vert`; with a define,
# hemicube.vert:LAYERED becomes "shaders/hemicube.vert.LAYERED.h" with `hemicube_vert_LAYERED`.
# A dependency file makes a change in any included file rebuild the shader. The plain .spv files
# lie beside the headers, so that a validator can read them.
function(farol_compile_shaders target)
  cmake_parse_arguments(ARG "" "FROM" "SHADERS" ${ARGN})
  if(NOT ARG_FROM)
    set(ARG_FROM ${CMAKE_SOURCE_DIR}/shaders)
  endif()
  set(out ${CMAKE_BINARY_DIR}/shaders)
  file(MAKE_DIRECTORY ${out})
  foreach(entry IN LISTS ARG_SHADERS)
    string(REPLACE ":" ";" parts ${entry})
    list(GET parts 0 name)
    list(LENGTH parts count)
    set(defines "")
    set(stem ${name})
    if(count GREATER 1)
      list(GET parts 1 define)
      set(defines -D${define})
      set(stem ${name}.${define})
    endif()
    string(REPLACE "." "_" variable ${stem})
    set(source ${ARG_FROM}/${name})
    add_custom_command(
      OUTPUT ${out}/${stem}.h ${out}/${stem}.spv
      COMMAND ${GLSLANG_VALIDATOR} --quiet --target-env vulkan1.3 ${defines} -I${CMAKE_SOURCE_DIR}/shaders
              --depfile ${out}/${stem}.d -o ${out}/${stem}.spv ${source}
      COMMAND ${GLSLANG_VALIDATOR} --quiet --target-env vulkan1.3 ${defines} -I${CMAKE_SOURCE_DIR}/shaders
              --vn ${variable} -o ${out}/${stem}.h ${source}
      DEPENDS ${source}
      DEPFILE ${out}/${stem}.d
      COMMENT "Shader ${stem}"
      VERBATIM)
    list(APPEND headers ${out}/${stem}.h)
  endforeach()
  target_sources(${target} PRIVATE ${headers})
  target_include_directories(${target} PRIVATE ${CMAKE_BINARY_DIR})
endfunction()
