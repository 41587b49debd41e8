# Each public header compiles alone, as C11 and as C++.
add_test(NAME headers COMMAND ${CMAKE_COMMAND} -DINCLUDE=${PROJECT_SOURCE_DIR}/include -DCC=${CMAKE_C_COMPILER}
    -P ${PROJECT_SOURCE_DIR}/tests/install/headers.cmake)
set_tests_properties(headers PROPERTIES LABELS "package;slow")
# The tool includes public headers and its own ones, nothing of src.
add_test(NAME tool_headers COMMAND ${CMAKE_COMMAND} -DSOURCE=${PROJECT_SOURCE_DIR}
    -P ${PROJECT_SOURCE_DIR}/tests/install/tool_headers.cmake)
set_tests_properties(tool_headers PROPERTIES LABELS package)
