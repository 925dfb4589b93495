# Write the shaders as C arrays: cmake -D GLSL=FOLDER -D OUTPUT=FILE.c -P embed_shaders.cmake
#
# Each stage of FOLDER, and the function for shaders of a host, becomes one array, gsgi__shader_<folder>_<pass>_<stage>, with its includes expanded once. Bytes,
# not string literals: C99 promises those no more than 4,095 characters.

cmake_minimum_required(VERSION 3.21)

set(STAGES
    lib/fullscreen.vert surface/points.frag surface/read.frag surface/smooth.frag surface/resolve.frag
    surface/add_light.frag surface/gsgi_indirect.glsl over/splat.vert over/splat.frag)

# Text of FOLDER/name in `result`, with the files included that are not in the global property `seen` yet.
function(expand name result)
    file(READ "${GLSL}/${name}" text)
    set(expanded "")
    while(text MATCHES "#include \"([^\"]+)\"")
        set(line "${CMAKE_MATCH_0}")
        set(file "${CMAKE_MATCH_1}")
        string(FIND "${text}" "${line}" begin)
        string(LENGTH "${line}" length)
        math(EXPR end "${begin} + ${length}")
        string(SUBSTRING "${text}" 0 ${begin} before)
        string(SUBSTRING "${text}" ${end} -1 text)
        set(included "")
        get_property(seen GLOBAL PROPERTY seen)
        if(NOT file IN_LIST seen)
            set_property(GLOBAL APPEND PROPERTY seen "${file}")
            expand("${file}" included)
        endif()
        string(APPEND expanded "${before}${included}")
    endwhile()
    set(${result} "${expanded}${text}" PARENT_SCOPE)
endfunction()

set(source "/* Written by embed_shaders.cmake. */\n#include \"shaders.h\"\n")
foreach(stage IN LISTS STAGES)
    set_property(GLOBAL PROPERTY seen "")
    expand("${stage}" text)
    string(HEX "${text}" bytes)
    string(REGEX REPLACE "(..)" "0x\\1," bytes "${bytes}")
    string(REGEX REPLACE "(0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,)" "\\1\n" bytes "${bytes}")
    string(REGEX REPLACE "[/.]" "_" name "${stage}")
    string(APPEND source "\nconst char gsgi__shader_${name}[] = {\n${bytes}0};\n")
endforeach()
file(WRITE "${OUTPUT}" "${source}")
