# The programs of examples/, built as a user would: C11, public headers, the library, no flags of the project's own.
set(SG_EXAMPLES train audit render_from_memory scene_from_memory)
foreach(name ${SG_EXAMPLES})
    add_executable(example_${name} ${PROJECT_SOURCE_DIR}/examples/${name}.c)
    set_target_properties(example_${name} PROPERTIES OUTPUT_NAME ${name} C_EXTENSIONS OFF
        RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/examples)
    target_compile_options(example_${name} PRIVATE -Wall -Wextra -Werror -pedantic)
    target_link_libraries(example_${name} PRIVATE splatguard::splatguard m)
    if(SG_SANITIZE)
        target_compile_options(example_${name} PRIVATE -fsanitize=${SG_SANITIZE})
        target_link_options(example_${name} PRIVATE -fsanitize=${SG_SANITIZE})
    endif()
endforeach()
add_test(NAME examples COMMAND sh ${PROJECT_SOURCE_DIR}/tests/examples.sh $<TARGET_FILE:splatguard_tool>
    ${PROJECT_BINARY_DIR}/examples)
set_tests_properties(examples PROPERTIES LABELS package)
# What docs/embedding.md quotes is in the examples and headers, word for word.
add_test(NAME embedding COMMAND ${CMAKE_COMMAND} -DSOURCE=${PROJECT_SOURCE_DIR}
    -P ${PROJECT_SOURCE_DIR}/tests/install/embedding.cmake)
set_tests_properties(embedding PROPERTIES LABELS package)
