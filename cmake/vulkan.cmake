# The Vulkan engine is built where glslangValidator and Vulkan's headers are. Its kernels become arrays in C; the loader is
# opened at run time, so that nothing is linked.
option(SG_VULKAN "Build the Vulkan engine where its tools are installed" ON)
find_program(GLSLANG_VALIDATOR glslangValidator)
find_path(VULKAN_HEADERS vulkan/vulkan.h)
set(SG_HAVE_VULKAN OFF)
if(SG_VULKAN AND GLSLANG_VALIDATOR AND VULKAN_HEADERS)
    set(SG_HAVE_VULKAN ON)
endif()
set(vulkan_dir ${PROJECT_SOURCE_DIR}/src/engine/vulkan)
if(NOT SG_HAVE_VULKAN)
    message(STATUS "Vulkan engine: left out (glslangValidator: ${GLSLANG_VALIDATOR}, vulkan/vulkan.h: ${VULKAN_HEADERS})")
    target_sources(splatguard PRIVATE ${vulkan_dir}/absent.c)
    return()
endif()

file(GLOB SG_VULKAN_SOURCES CONFIGURE_DEPENDS ${vulkan_dir}/*.c)
list(REMOVE_ITEM SG_VULKAN_SOURCES ${vulkan_dir}/absent.c)
file(GLOB SG_SHADERS CONFIGURE_DEPENDS ${vulkan_dir}/shaders/*.comp)
set(spirv_dir ${PROJECT_BINARY_DIR}/spirv)
set(spirv_text "/* Made by cmake/vulkan.cmake. */\n#include \"engine/vulkan/gpu.h\"\n")
# Makes ${spirv_dir}/NAME.h, with the words of a shader as sg_spirv_NAME.
function(sg_spirv shader name)
    add_custom_command(OUTPUT ${spirv_dir}/${name}.h
        COMMAND ${GLSLANG_VALIDATOR} -V --quiet --target-env vulkan1.2 --vn sg_spirv_${name} -I${PROJECT_SOURCE_DIR}/src
            -I${vulkan_dir}/shaders --depfile ${spirv_dir}/${name}.d -o ${spirv_dir}/${name}.h ${shader}
        DEPENDS ${shader} DEPFILE ${spirv_dir}/${name}.d VERBATIM)
endfunction()
foreach(shader ${SG_SHADERS})
    get_filename_component(name ${shader} NAME_WE)
    sg_spirv(${shader} ${name})
    list(APPEND spirv_headers ${spirv_dir}/${name}.h)
    string(APPEND spirv_text "#include \"${name}.h\"\n")
endforeach()
string(APPEND spirv_text "\nconst struct gpu_code sg_vulkan_code[GPU_KERNELS] = {\n"
    "#define K(name) [GPU_##name] = {sg_spirv_##name, sizeof(sg_spirv_##name)},\n    VK_KERNELS(K)\n#undef K\n};\n")
file(CONFIGURE OUTPUT ${spirv_dir}/spirv.c CONTENT "${spirv_text}" @ONLY)
set_source_files_properties(${spirv_dir}/spirv.c PROPERTIES OBJECT_DEPENDS "${spirv_headers}" INCLUDE_DIRECTORIES ${spirv_dir})
target_sources(splatguard PRIVATE ${SG_VULKAN_SOURCES} ${spirv_dir}/spirv.c)
target_include_directories(splatguard PRIVATE ${VULKAN_HEADERS})
target_link_libraries(splatguard PRIVATE ${CMAKE_DL_LIBS})
