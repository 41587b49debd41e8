# Installs into a scratch prefix and uses the result as a stranger would: pkg-config, CMake, the tool, the man page.
add_test(NAME install COMMAND ${CMAKE_COMMAND} -DBUILD=${PROJECT_BINARY_DIR} -DPREFIX=${PROJECT_BINARY_DIR}/tests/prefix
    -DSOURCE=${PROJECT_SOURCE_DIR} -DCC=${CMAKE_C_COMPILER} -DGENERATOR=${CMAKE_GENERATOR} -DSANITIZE=${SG_SANITIZE}
    -DLIBDIR=${CMAKE_INSTALL_LIBDIR} -DVERSION=${PROJECT_VERSION} -P ${PROJECT_SOURCE_DIR}/tests/install/check.cmake)
set_tests_properties(install PROPERTIES LABELS "package;slow")
