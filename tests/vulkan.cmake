# What runs on a device, for bench/gpu too: programs of CTest, programs for devices alone, and scripts. A row of the list in
# the build folder has a name, and a program in that folder or a script in the source.
set(device_suite engine operations views scaffold devices)
set(device_programs ascend changes gaussians crowded anisotropy scaffold_training anchor_removal anchor_readings variants flow
    device_memory device_parts)
# Scripts of the command line with this engine instead of the default, on smaller scenes where they take long. Those that
# are left out compute nothing: options, help, completions and pages. The filter of defense_anchors has nothing to do in so
# short a run: the program anchor_readings is about it.
file(GLOB device_scripts CONFIGURE_DEPENDS tests/cli/*.sh)
list(FILTER device_scripts EXCLUDE REGEX "/(common|completion|defense_anchors|docs|tables|usage)\\.sh$")
list(TRANSFORM device_scripts REPLACE ".*/(.*)\\.sh$" "\\1")
if(SG_HAVE_VULKAN)
    set(rows "")
    add_library(engine_bytes OBJECT tests/engine_bytes.c)
    target_include_directories(engine_bytes PRIVATE src include)
    target_link_libraries(engine_bytes PRIVATE sg_flags)
    foreach(name ${device_suite} ${device_programs} bytes vulkan)
        string(APPEND rows "${name}\ttest_${name}\n")
        target_sources(test_${name} PRIVATE $<TARGET_OBJECTS:engine_bytes>)
        foreach(call download read_gradients read_image read_statistics count_hits weigh_hits ascend read_exposures read_step)
            target_link_options(test_${name} PRIVATE $<$<NOT:$<PLATFORM_ID:Darwin>>:-Wl,--wrap=sg_engine_${call}>)
        endforeach()
    endforeach()
    foreach(name ${device_scripts})
        string(APPEND rows "${name}.sh\ttests/cli/${name}.sh\n")
    endforeach()
    file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/device-tests CONTENT "${rows}" @ONLY)
endif()

# The suite of the engines on Mesa's driver for the CPU (lavapipe), at its three vector widths, which are subgroups of 4,
# 8 and 16. The validation layer is on, with checks of missing barriers: any message is a failure.
if(SG_HAVE_VULKAN AND NOT SG_SANITIZE)
    file(GLOB SG_LAVAPIPE /usr/share/vulkan/icd.d/lvp_icd.*.json /usr/local/share/vulkan/icd.d/lvp_icd.*.json)
    find_file(SG_VALIDATION VkLayer_khronos_validation.json PATHS /usr/share/vulkan/explicit_layer.d
        /usr/local/share/vulkan/explicit_layer.d NO_DEFAULT_PATH)
endif()
if(SG_LAVAPIPE AND SG_VALIDATION)
    list(GET SG_LAVAPIPE 0 icd)
    # The engine's own C again, with sanitizers, in the programs that end in _sanitized: its objects stand in for those of
    # the library. Nothing looks for leaks there: the drivers leak, and the ledgers of host and device are checked anyway.
    option(SG_VULKAN_SANITIZED "Build tests of the Vulkan engine with its C under address and undefined sanitizers" OFF)
    set(suffix "")
    if(SG_VULKAN_SANITIZED)
        set(suffix _sanitized)
        set(sanitizers -fsanitize=address,undefined -fno-sanitize-recover=all -g -fno-omit-frame-pointer)
        add_library(vulkan_sanitized OBJECT ${SG_VULKAN_SOURCES} ${PROJECT_SOURCE_DIR}/src/core/vram.c)
        target_include_directories(vulkan_sanitized PRIVATE src include ${VULKAN_HEADERS})
        target_link_libraries(vulkan_sanitized PRIVATE sg_flags)
        target_compile_options(vulkan_sanitized PRIVATE ${sanitizers} -ffp-contract=off)
        foreach(source tests/engine/test_operations.c tests/engine/test_ascend.c tests/engine/test_changes.c
            tests/engine/test_gaussians.c tests/engine/test_views.c tests/engine/test_anisotropy.c
            tests/test_flow.c)
            get_filename_component(name ${source} NAME_WE)
            add_executable(${name}_sanitized ${source} $<TARGET_OBJECTS:vulkan_sanitized>)
            target_include_directories(${name}_sanitized PRIVATE src tests ${VULKAN_HEADERS})
            target_link_libraries(${name}_sanitized PRIVATE splatguard_internal sg_flags sg_overrides PkgConfig::CMOCKA)
            target_link_options(${name}_sanitized PRIVATE ${sanitizers})
        endforeach()
    endif()
    function(sg_vulkan_test name program width)
        add_test(NAME vulkan_${name}_${width} COMMAND ${program} ${ARGN})
        set_tests_properties(vulkan_${name}_${width} PROPERTIES LABELS vulkan TIMEOUT 900
            ENVIRONMENT "ASAN_OPTIONS=detect_leaks=0;SG_TEST_ENGINE=vulkan:llvmpipe;LP_NATIVE_VECTOR_WIDTH=${width};VK_ICD_FILENAMES=${icd};VK_DRIVER_FILES=${icd};VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation;VK_LAYER_SETTINGS_PATH=${PROJECT_SOURCE_DIR}/tests/vulkan"
            FAIL_REGULAR_EXPRESSION "Validation (Error|Warning|Performance);VUID-;UNASSIGNED-;SYNC-HAZARD;FAILED")
    endfunction()
    # Trained models and the results of all operations have the same bytes at each width and with any number of the driver's
    # threads. The programs print hashes, which go to files; these are compared.
    set(hashes ${PROJECT_BINARY_DIR}/vulkan-hashes)
    function(sg_vulkan_hashes name program width)
        set(file ${hashes}-${name}_${width})
        sg_vulkan_test(${name} sh ${width} ${CMAKE_CURRENT_SOURCE_DIR}/tests/vulkan/hashes.sh $<TARGET_FILE:${program}> ${file})
        set_tests_properties(vulkan_${name}_${width} PROPERTIES FIXTURES_SETUP ${name}_${width})
    endfunction()
    function(sg_vulkan_same one other)
        add_test(NAME vulkan_same_${other} COMMAND ${CMAKE_COMMAND} -E compare_files ${hashes}-${one} ${hashes}-${other})
        set_tests_properties(vulkan_same_${other} PROPERTIES LABELS vulkan FIXTURES_REQUIRED "${one};${other}")
    endfunction()
    function(sg_vulkan_program name suffix width) # the one with this suffix, if it has been built
        if(TARGET test_${name}${suffix})
            sg_vulkan_test(${name} test_${name}${suffix} ${width})
        else()
            sg_vulkan_test(${name} test_${name} ${width})
        endif()
    endfunction()
    foreach(width 128 256 512)
        set(with "")
        if(width EQUAL 256) # what sanitizers look at is the same at each width
            set(with ${suffix})
        endif()
        foreach(name ${device_suite})
            sg_vulkan_program(${name} "${with}" ${width})
        endforeach()
        sg_vulkan_hashes(training test_vulkan ${width})
        sg_vulkan_hashes(bytes test_bytes ${width})
    endforeach()
    sg_vulkan_hashes(bytes_one_thread test_bytes 256)
    # The driver's threads: as many as the machine has, unless this says more.
    set_property(TEST vulkan_training_256 vulkan_bytes_256 APPEND PROPERTY ENVIRONMENT LP_NUM_THREADS=2)
    set_property(TEST vulkan_training_512 vulkan_bytes_512 vulkan_bytes_one_thread_256 APPEND PROPERTY ENVIRONMENT LP_NUM_THREADS=1)
    foreach(width 128 512)
        sg_vulkan_same(training_256 training_${width})
        sg_vulkan_same(bytes_256 bytes_${width})
    endforeach()
    sg_vulkan_same(bytes_256 bytes_one_thread_256)
    foreach(name ${device_programs})
        sg_vulkan_program(${name} "${suffix}" 256)
    endforeach()
    sg_vulkan_test(device_faults test_device_faults 256)
    set_property(TEST vulkan_device_faults_256 APPEND PROPERTY ENVIRONMENT LP_NUM_THREADS=0) # no threads to wait for: half the time
    # The layer is there and is heard: what must be a failure is one.
    add_executable(vulkan_canary tests/vulkan/canary.c)
    target_include_directories(vulkan_canary PRIVATE src tests ${VULKAN_HEADERS})
    target_link_libraries(vulkan_canary PRIVATE splatguard_internal sg_flags sg_overrides PkgConfig::CMOCKA)
    sg_wrap(vulkan_canary ${WRAPPED_BY_CALLS})
    set(canary sh 256 ${CMAKE_CURRENT_SOURCE_DIR}/tests/vulkan/canary.sh $<TARGET_FILE:vulkan_canary>)
    sg_vulkan_test(canary_call ${canary} call VUID-vkCmdFillBuffer-size-00028)
    sg_vulkan_test(canary_barriers ${canary} barriers SYNC-HAZARD-READ)
    set_tests_properties(vulkan_canary_call_256 vulkan_canary_barriers_256 PROPERTIES WILL_FAIL TRUE)
    sg_vulkan_test(canary_silent vulkan_canary 256 neither)
    # Without the layer, but for the one that tries every command.
    function(sg_vulkan_script name)
        add_test(NAME vulkan_script_${name} COMMAND sh ${ARGN} ${PROJECT_SOURCE_DIR}/tests/cli/${name}.sh
            $<TARGET_FILE:splatguard_tool> ${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR}/vulkan-tests/${name})
        set_tests_properties(vulkan_script_${name} PROPERTIES LABELS vulkan SKIP_RETURN_CODE 77 TIMEOUT 900
            ENVIRONMENT "SG_TEST_ENGINE=vulkan:llvmpipe;VK_ICD_FILENAMES=${icd};VK_DRIVER_FILES=${icd}")
    endfunction()
    if(TARGET splatguard_tool)
        foreach(name ${device_scripts})
            if(name STREQUAL outputs)
                sg_vulkan_script(${name} ${CMAKE_CURRENT_SOURCE_DIR}/tests/vulkan/with_layer.sh)
            else()
                sg_vulkan_script(${name})
            endif()
        endforeach()
    endif()
    add_test(NAME vulkan_stages COMMAND sh ${CMAKE_CURRENT_SOURCE_DIR}/tests/bench/stages.sh $<TARGET_FILE:splatguard_bench>
        vulkan:llvmpipe ${PROJECT_BINARY_DIR}/bench-tests/vulkan)
    set_tests_properties(vulkan_stages PROPERTIES LABELS vulkan ENVIRONMENT "VK_ICD_FILENAMES=${icd};VK_DRIVER_FILES=${icd}")
    if(TARGET splatguard_tool)
        add_test(NAME vulkan_gpu_dry_run COMMAND sh ${CMAKE_CURRENT_SOURCE_DIR}/tests/bench/gpu.sh ${PROJECT_SOURCE_DIR}
            ${PROJECT_BINARY_DIR} llvmpipe ${PROJECT_BINARY_DIR}/bench-tests/gpu)
        set_tests_properties(vulkan_gpu_dry_run PROPERTIES LABELS vulkan ENVIRONMENT "VK_ICD_FILENAMES=${icd};VK_DRIVER_FILES=${icd}")
    endif()
    # Mesa's driver for AMD compiles every kernel for GPUs that are not there: none spills registers.
    file(GLOB SG_RADV /usr/share/vulkan/icd.d/radeon_icd.*.json /usr/local/share/vulkan/icd.d/radeon_icd.*.json)
    list(APPEND SG_RADV none)
    list(GET SG_RADV 0 radv)
    foreach(place vega10_64 navi21_64 navi21_32 gfx1100_64 gfx1100_32) # GPU, subgroup
        string(REPLACE "_" ";" parts ${place})
        list(GET parts 0 family)
        add_test(NAME vulkan_registers_${place} COMMAND splatguard_registers)
        set_tests_properties(vulkan_registers_${place} PROPERTIES LABELS vulkan SKIP_RETURN_CODE 77
            ENVIRONMENT "RADV_FORCE_FAMILY=${family};VK_ICD_FILENAMES=${radv};VK_DRIVER_FILES=${radv}")
        if(place MATCHES "_32$")
            set_property(TEST vulkan_registers_${place} APPEND PROPERTY ENVIRONMENT RADV_PERFTEST=cswave32)
        endif()
    endforeach()
else()
    add_test(NAME vulkan COMMAND sh -c
        "echo 'skipped: needs the Vulkan engine (no sanitizer), mesa-vulkan-drivers and vulkan-validationlayers'; exit 77")
    set_tests_properties(vulkan PROPERTIES LABELS vulkan SKIP_RETURN_CODE 77)
endif()
