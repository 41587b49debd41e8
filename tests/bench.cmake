# The benchmark for a moment, so that it cannot rot. tests/vulkan.cmake has it on a device.
add_test(NAME bench_stages COMMAND sh ${PROJECT_SOURCE_DIR}/tests/bench/stages.sh $<TARGET_FILE:splatguard_bench> cpu
    ${PROJECT_BINARY_DIR}/bench-tests/cpu)
set_tests_properties(bench_stages PROPERTIES LABELS slow)
