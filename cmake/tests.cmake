# Every tests/test_*.c is one cmocka program and one CTest entry. Tests may include the library's private headers.
pkg_check_modules(CMOCKA IMPORTED_TARGET cmocka) # plain C, works under sanitizers
if(NOT CMOCKA_FOUND)
    message(FATAL_ERROR "The tests need cmocka, which is missing; -DBUILD_TESTING=OFF leaves them out")
endif()
# Labels select tests for the parts of ./check: `threads` for the thread sanitizer, `package` for what is installed, `slow`
# for what sanitizers need not repeat, `fuzz`, `memory`. A new test gets `threads`, unless it is listed here: it has one
# thread, or those of test_trainer (test_budget).
set(SG_SERIAL test_alloc_failure test_budget test_checkpoint test_columns test_disk_errors test_folder test_format test_gradients
    test_image test_interrupt test_path test_ply test_sog)
file(GLOB SG_TESTS CONFIGURE_DEPENDS tests/test_*.c tests/engine/test_*.c)
if(NOT ZLIB_FOUND)
    message(STATUS "test_format, test_sog, test_archive, test_disk_errors: left out, zlib is missing")
    list(FILTER SG_TESTS EXCLUDE REGEX "test_(format|sog|archive|disk_errors)")
endif()
if(NOT SG_HAVE_VULKAN)
    list(FILTER SG_TESTS EXCLUDE REGEX "test_devices|test_device_memory|test_device_parts|test_device_faults|test_flow")
endif()
add_compile_options($<$<CONFIG:Release>:-O1>) # tests take longer to compile than to run
if(SG_SANITIZE) # compilers do not agree on macros: SG_SANITIZE_ADDRESS, SG_SANITIZE_THREAD or SG_SANITIZE_MEMORY
    string(REGEX REPLACE ",.*" "" first "${SG_SANITIZE}")
    string(TOUPPER ${first} first)
    add_compile_definitions(SG_SANITIZE_${first})
endif()
foreach(source ${SG_TESTS})
    get_filename_component(name ${source} NAME_WE)
    add_executable(${name} ${source})
    target_include_directories(${name} PRIVATE src tests $<$<BOOL:${SG_HAVE_VULKAN}>:${VULKAN_HEADERS}>)
    target_link_libraries(${name} PRIVATE splatguard_internal sg_flags sg_overrides PkgConfig::CMOCKA PkgConfig::SPNG PkgConfig::TURBOJPEG
        PkgConfig::WEBP PkgConfig::JANSSON $<$<BOOL:${ZLIB_FOUND}>:PkgConfig::ZLIB> Threads::Threads m)
    target_compile_definitions(${name} PRIVATE SG_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
    add_test(NAME ${name} COMMAND ${name})
    set_tests_properties(${name} PROPERTIES SKIP_RETURN_CODE 77 TIMEOUT 900)
    if(NOT name IN_LIST SG_SERIAL)
        set_tests_properties(${name} PROPERTIES LABELS threads)
        list(APPEND threaded ${name})
    endif()
endforeach()
add_custom_target(thread_tests DEPENDS ${threaded})
if(TARGET splatguard_tool)
    add_dependencies(thread_tests splatguard_tool) # of cli_train
endif()

# The library's calls of these functions go to __wrap_NAME of the test, which has __real_NAME too.
function(sg_wrap program)
    foreach(name ${ARGN})
        target_link_options(${program} PRIVATE LINKER:--wrap=${name})
    endforeach()
endfunction()
target_sources(test_interrupt PRIVATE cli/interrupt.c)
target_include_directories(test_interrupt PRIVATE cli)
if(TARGET test_disk_errors)
    sg_wrap(test_disk_errors pread)
endif()
if(SG_HAVE_VULKAN)
    sg_wrap(test_devices dlopen dlsym dlclose)
    set(WRAPPED_BY_CALLS sg_vk_open sg_vk_open_device) # tests/driver_calls.h
    sg_wrap(test_device_memory ${WRAPPED_BY_CALLS})
    sg_wrap(test_device_faults ${WRAPPED_BY_CALLS})
    target_sources(test_device_parts PRIVATE bench/device.c)
    target_include_directories(test_device_parts PRIVATE bench ${spirv_dir})
    add_dependencies(test_device_parts splatguard_bench) # which makes its kernels
endif()

set_property(TEST test_scene_data APPEND PROPERTY LABELS slow) # whole captures, where somebody has them

# Every kernel against its oracle, one by one; `build/checkkernels --bench` times them.
file(GLOB SG_CHECKS CONFIGURE_DEPENDS tests/kernels/*.c)
add_executable(checkkernels ${SG_CHECKS})
target_include_directories(checkkernels PRIVATE src tests)
target_link_libraries(checkkernels PRIVATE splatguard_internal sg_flags sg_overrides PkgConfig::CMOCKA Threads::Threads m)
target_compile_options(checkkernels PRIVATE -O2)
add_test(NAME kernels COMMAND checkkernels)

# The memory sanitizer takes everything that image and JSON libraries write for uninitialised, since they are not compiled
# with it. So only tests that use none of them have this label; the target builds them alone. Tests that count hits through
# an engine are left out too: of the three instruction sets it objects to AVX-512 alone, whose masked loads it does not
# follow.
set(SG_MEMORY test_operations test_gaussians test_attack test_audit test_audit_photo test_begin test_checkpoint
    test_columns test_core test_densify test_eval test_fft test_gradients test_model test_morton test_noise test_ply
    test_residual test_spectrum test_strategy test_threads test_tolerance test_trainer)
foreach(name ${SG_MEMORY})
    set_property(TEST ${name} APPEND PROPERTY LABELS memory)
endforeach()
set_property(TEST kernels APPEND PROPERTY LABELS memory)
add_custom_target(memory_tests DEPENDS ${SG_MEMORY} checkkernels)

file(GLOB SG_TEST_PARTS CONFIGURE_DEPENDS tests/*.cmake)
foreach(part ${SG_TEST_PARTS})
    include(${part})
endforeach()

# What tests with the label `package` use.
add_custom_target(package_tests DEPENDS splatguard)
foreach(name ${SG_EXAMPLES})
    add_dependencies(package_tests example_${name})
endforeach()
if(TARGET splatguard_tool)
    add_dependencies(package_tests splatguard_tool)
endif()
if(TARGET man)
    add_dependencies(package_tests man)
endif()

# The suite is for the CPU engine, whatever GPUs the machine has: the tests that have no drivers of their own see none.
get_property(all DIRECTORY PROPERTY TESTS)
foreach(name ${all})
    get_property(labels TEST ${name} PROPERTY LABELS)
    if(NOT "vulkan" IN_LIST labels)
        set_property(TEST ${name} APPEND PROPERTY ENVIRONMENT VK_DRIVER_FILES=/dev/null VK_ICD_FILENAMES=/dev/null)
    endif()
endforeach()
