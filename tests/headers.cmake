# Each public header compiles alone, as C11 and as C++.
add_test(NAME headers COMMAND ${CMAKE_COMMAND} -DINCLUDE=${PROJECT_SOURCE_DIR}/include -DCC=${CMAKE_C_COMPILER}
    -P ${PROJECT_SOURCE_DIR}/tests/install/headers.cmake)
set_tests_properties(headers PROPERTIES LABELS "package;slow")
