# The library exports sg_ names only, defines all that its headers declare, and never exits, aborts or prints.
add_test(NAME symbols COMMAND ${CMAKE_COMMAND} -DNM=${CMAKE_NM} -DLIBRARY=$<TARGET_FILE:splatguard>
    -DINCLUDE=${PROJECT_SOURCE_DIR}/include -P ${PROJECT_SOURCE_DIR}/tests/install/symbols.cmake)
set_tests_properties(symbols PROPERTIES LABELS package)
if(SG_SANITIZE) # which adds symbols of its own
    set_tests_properties(symbols PROPERTIES DISABLED ON)
endif()
