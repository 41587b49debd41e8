# Builds the Debian packages and installs them into a scratch root. With the packaging tests of the shared library only,
# since it builds everything once more.
find_program(SG_DPKG_DEB dpkg-deb)
if(SG_DPKG_DEB AND BUILD_SHARED_LIBS AND TARGET splatguard_tool AND NOT SG_SANITIZE)
    add_test(NAME deb COMMAND bash ${PROJECT_SOURCE_DIR}/tests/deb.sh ${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR}/tests/deb)
    set_tests_properties(deb PROPERTIES LABELS "package;slow" SKIP_RETURN_CODE 77 TIMEOUT 1800)
endif()
