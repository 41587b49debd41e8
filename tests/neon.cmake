# The NEON kernels on machines without it: cross compiled and emulated. Needs Debian's gcc-aarch64-linux-gnu and qemu-user.
find_program(SG_AARCH64_CC aarch64-linux-gnu-gcc)
find_program(SG_AARCH64_QEMU NAMES qemu-aarch64 qemu-aarch64-static)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64" AND SG_AARCH64_CC AND SG_AARCH64_QEMU AND NOT SG_SANITIZE)
    add_test(NAME neon COMMAND ${CMAKE_COMMAND} -DCC=${SG_AARCH64_CC} -DQEMU=${SG_AARCH64_QEMU}
        -DSOURCE=${PROJECT_SOURCE_DIR} -DBUILD=${PROJECT_BINARY_DIR}/tests/neon -DVERSION=${PROJECT_VERSION}
        -P ${PROJECT_SOURCE_DIR}/tests/neon/check.cmake)
    set_tests_properties(neon PROPERTIES LABELS neon TIMEOUT 900)
endif()
