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
    foreach(width 128 256 512)
        set(with "")
        if(width EQUAL 256) # what sanitizers look at is the same at each width
            set(with ${suffix})
        endif()
        sg_vulkan_test(engine test_engine ${width})
        sg_vulkan_test(operations test_operations${with} ${width})
        sg_vulkan_test(views test_views${with} ${width})
        sg_vulkan_test(scaffold test_scaffold ${width})
        # A trained model has the same bytes at each width, and with one thread of the driver as with all.
        set(models ${PROJECT_BINARY_DIR}/vulkan-models)
        sg_vulkan_test(training sh ${width} ${CMAKE_CURRENT_SOURCE_DIR}/tests/vulkan/models.sh $<TARGET_FILE:test_vulkan> ${models}-${width})
        set_tests_properties(vulkan_training_${width} PROPERTIES FIXTURES_SETUP models_${width})
    endforeach()
    foreach(width 128 512)
        add_test(NAME vulkan_widths_${width} COMMAND ${CMAKE_COMMAND} -E compare_files ${models}-256 ${models}-${width})
        set_tests_properties(vulkan_widths_${width} PROPERTIES LABELS vulkan FIXTURES_REQUIRED "models_256;models_${width}")
    endforeach()
    set_property(TEST vulkan_training_512 APPEND PROPERTY ENVIRONMENT LP_NUM_THREADS=1)
    sg_vulkan_test(ascend test_ascend${suffix} 256)
    sg_vulkan_test(changes test_changes${suffix} 256)
    sg_vulkan_test(gaussians test_gaussians${suffix} 256)
    sg_vulkan_test(anisotropy test_anisotropy${suffix} 256)
    sg_vulkan_test(scaffold_training test_scaffold_training 256)
    sg_vulkan_test(anchor_removal test_anchor_removal 256)
    sg_vulkan_test(flow test_flow${suffix} 256)
    sg_vulkan_test(memory test_device_memory 256)
    sg_vulkan_test(devices test_devices 256)
    # Scripts of the command line with this engine instead of the default, without the layer. The others compute nothing or
    # stop before they do (usage), or take minutes on such a driver: those have a short form here.
    function(sg_vulkan_script name script)
        add_test(NAME vulkan_script_${name} COMMAND sh ${script} $<TARGET_FILE:splatguard_tool> ${PROJECT_SOURCE_DIR}
            ${PROJECT_BINARY_DIR}/vulkan-tests/${name})
        set_tests_properties(vulkan_script_${name} PROPERTIES LABELS vulkan SKIP_RETURN_CODE 77 TIMEOUT 900
            ENVIRONMENT "SG_TEST_ENGINE=vulkan:llvmpipe;VK_ICD_FILENAMES=${icd};VK_DRIVER_FILES=${icd}")
    endfunction()
    if(TARGET splatguard_tool)
        foreach(name train resume killed models outputs prune report_run anchors convert errors archive exit_status smooth race)
            sg_vulkan_script(${name} ${PROJECT_SOURCE_DIR}/tests/cli/${name}.sh)
        endforeach()
        foreach(name defense_attack view bench end_to_end)
            sg_vulkan_script(${name} ${CMAKE_CURRENT_SOURCE_DIR}/tests/vulkan/${name}.sh)
        endforeach()
    endif()
    # Mesa's driver for AMD compiles every kernel for GPUs that are not there: none spills registers.
    file(GLOB SG_RADV /usr/share/vulkan/icd.d/radeon_icd.*.json /usr/local/share/vulkan/icd.d/radeon_icd.*.json)
    list(APPEND SG_RADV none)
    list(GET SG_RADV 0 radv)
    foreach(family vega10 navi21 gfx1100)
        add_test(NAME vulkan_registers_${family} COMMAND splatguard_registers)
        set_tests_properties(vulkan_registers_${family} PROPERTIES LABELS vulkan SKIP_RETURN_CODE 77
            ENVIRONMENT "RADV_FORCE_FAMILY=${family};RADV_PERFTEST=cswave32;VK_ICD_FILENAMES=${radv};VK_DRIVER_FILES=${radv}")
    endforeach()
else()
    add_test(NAME vulkan COMMAND sh -c
        "echo 'skipped: needs the Vulkan engine (no sanitizer), mesa-vulkan-drivers and vulkan-validationlayers'; exit 77")
    set_tests_properties(vulkan PROPERTIES LABELS vulkan SKIP_RETURN_CODE 77)
endif()
