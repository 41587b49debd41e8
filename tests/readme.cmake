# The program in README.md compiles without warnings as C11, C++17 and C++20, with every compiler that is installed.
find_program(SG_GCC gcc)
find_program(SG_CLANG clang)
add_test(NAME readme COMMAND ${CMAKE_COMMAND} -DREADME=${PROJECT_SOURCE_DIR}/README.md
    -DINCLUDE=${PROJECT_SOURCE_DIR}/include -DCOMPILERS=${CMAKE_C_COMPILER},${SG_GCC},${SG_CLANG}
    -DWORK=${PROJECT_BINARY_DIR}/tests/readme -P ${PROJECT_SOURCE_DIR}/tests/install/readme.cmake)
set_tests_properties(readme PROPERTIES LABELS "package;slow")
