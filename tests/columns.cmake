# A model with one more column than the library's: the files that loop over the table, compiled once more with its row.
file(GLOB SG_COLUMN_USERS CONFIGURE_DEPENDS src/core/*.c src/model/*.c src/engine/host/host_model.c
    src/model/morton.c)
add_executable(test_exported_column tests/columns/exported.c ${SG_COLUMN_USERS})
target_include_directories(test_exported_column PRIVATE include src tests)
target_compile_options(test_exported_column PRIVATE -include ${PROJECT_SOURCE_DIR}/tests/columns/toy_column.h)
target_link_libraries(test_exported_column PRIVATE sg_flags sg_overrides ${SG_DEPENDENCIES} PkgConfig::CMOCKA)
add_test(NAME test_exported_column COMMAND test_exported_column)
