# The suite of the engines on Mesa's driver for the CPU (lavapipe), at its three vector widths, which are subgroups of 4,
# 8 and 16. The validation layer is on, with checks of missing barriers: any message is a failure.
if(SG_HAVE_VULKAN AND NOT SG_SANITIZE)
    file(GLOB SG_LAVAPIPE /usr/share/vulkan/icd.d/lvp_icd.*.json /usr/local/share/vulkan/icd.d/lvp_icd.*.json)
    find_file(SG_VALIDATION VkLayer_khronos_validation.json PATHS /usr/share/vulkan/explicit_layer.d
        /usr/local/share/vulkan/explicit_layer.d NO_DEFAULT_PATH)
endif()
if(SG_LAVAPIPE AND SG_VALIDATION)
    list(GET SG_LAVAPIPE 0 icd)
    function(sg_vulkan_test name program width)
        add_test(NAME vulkan_${name}_${width} COMMAND ${program} ${ARGN})
        set_tests_properties(vulkan_${name}_${width} PROPERTIES LABELS vulkan TIMEOUT 900
            ENVIRONMENT "SG_TEST_ENGINE=vulkan:llvmpipe;LP_NATIVE_VECTOR_WIDTH=${width};VK_ICD_FILENAMES=${icd};VK_DRIVER_FILES=${icd};VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation;VK_LAYER_SETTINGS_PATH=${PROJECT_SOURCE_DIR}/tests/vulkan"
            FAIL_REGULAR_EXPRESSION "Validation (Error|Warning|Performance);VUID-;UNASSIGNED-;SYNC-HAZARD;FAILED")
    endfunction()
    foreach(width 128 256 512)
        sg_vulkan_test(engine test_engine ${width})
        sg_vulkan_test(operations test_operations ${width})
        sg_vulkan_test(views test_views ${width})
    endforeach()
    sg_vulkan_test(gaussians test_gaussians 256)
    sg_vulkan_test(training test_vulkan 256)
    sg_vulkan_test(memory test_device_memory 256)
    sg_vulkan_test(widths sh all ${CMAKE_CURRENT_SOURCE_DIR}/tests/vulkan/widths.sh $<TARGET_FILE:test_vulkan>)
else()
    add_test(NAME vulkan COMMAND sh -c
        "echo 'skipped: needs the Vulkan engine (no sanitizer), mesa-vulkan-drivers and vulkan-validationlayers'; exit 77")
    set_tests_properties(vulkan PROPERTIES LABELS vulkan SKIP_RETURN_CODE 77)
endif()
