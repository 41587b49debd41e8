# The command line tool, and its man pages and completions, which come from the option tables. It includes public headers only: `src` is not
# in its path, and a test looks.
file(GLOB SG_TOOL_SOURCES CONFIGURE_DEPENDS cli/*.c)
add_executable(splatguard_tool ${SG_TOOL_SOURCES})
set_target_properties(splatguard_tool PROPERTIES OUTPUT_NAME splatguard)
target_link_libraries(splatguard_tool PRIVATE splatguard sg_flags sg_overrides PkgConfig::JANSSON m)

# Man pages and completions for shells: one page for the tool, and one for each cli/cmd_NAME.c.
if(NOT CMAKE_CROSSCOMPILING)
    function(sg_help output)
        add_custom_command(OUTPUT ${output} COMMAND splatguard_tool help ${ARGN} > ${output} DEPENDS splatguard_tool VERBATIM)
        set_property(GLOBAL APPEND PROPERTY SG_HELP ${PROJECT_BINARY_DIR}/${output})
    endfunction()
    file(GLOB commands CONFIGURE_DEPENDS cli/cmd_*.c)
    list(TRANSFORM commands REPLACE ".*/cmd_(.*)\\.c$" "\\1")
    file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/man ${PROJECT_BINARY_DIR}/completions)
    sg_help(man/splatguard.1 --man)
    foreach(name ${commands})
        sg_help(man/splatguard-${name}.1 --man ${name})
    endforeach()
    foreach(shell bash zsh fish)
        sg_help(completions/${shell} --completion ${shell})
    endforeach()
    get_property(help GLOBAL PROPERTY SG_HELP)
    add_custom_target(man ALL DEPENDS ${help})
endif()

# Databases of results, for `bench` and `report`; both say so where SQLite is missing.
pkg_check_modules(SQLITE IMPORTED_TARGET sqlite3)
if(SQLITE_FOUND)
    target_compile_definitions(splatguard_tool PRIVATE SG_SQLITE)
    target_link_libraries(splatguard_tool PRIVATE PkgConfig::SQLITE)
endif()
# The commit that results are of; "unknown" outside a clone.
find_package(Git QUIET)
if(GIT_FOUND)
    execute_process(COMMAND ${GIT_EXECUTABLE} rev-parse --short HEAD WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
        OUTPUT_VARIABLE SG_COMMIT OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
endif()
set(reflog ${PROJECT_SOURCE_DIR}/.git/logs/HEAD) # another commit: configure again
if(EXISTS ${reflog})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${reflog})
endif()
if(NOT SG_COMMIT)
    set(SG_COMMIT unknown)
endif()
set_source_files_properties(cli/bench_store.c PROPERTIES COMPILE_DEFINITIONS SG_COMMIT="${SG_COMMIT}")
# An HTTP server, for `view` and `train --view`; both say so where it is missing. It is opened at run time, so that nothing
# is linked.
option(SG_HTTP "Build the live view where libmicrohttpd is" ON)
if(SG_HTTP)
    pkg_check_modules(MICROHTTPD libmicrohttpd>=0.9.71)
endif()
if(SG_HTTP AND MICROHTTPD_FOUND)
    set_source_files_properties(cli/view_server.c PROPERTIES
        COMPILE_DEFINITIONS SG_MICROHTTPD INCLUDE_DIRECTORIES "${MICROHTTPD_INCLUDE_DIRS}")
    target_link_libraries(splatguard_tool PRIVATE ${CMAKE_DL_LIBS} Threads::Threads)
endif()
# Scripts and styles of pages are in the program.
foreach(file cli/report.js cli/view.html cli/view.js cli/view.css cli/view_icon.svg src/report/page.css)
    get_filename_component(name ${file} NAME)
    string(REPLACE "." "_" name ${name})
    add_custom_command(OUTPUT ${name}.c COMMAND ${CMAKE_COMMAND} -DINPUT=${PROJECT_SOURCE_DIR}/${file}
        -DOUTPUT=${PROJECT_BINARY_DIR}/${name}.c -DNAME=${name} -P ${PROJECT_SOURCE_DIR}/cmake/embed.cmake
        DEPENDS ${PROJECT_SOURCE_DIR}/${file} ${PROJECT_SOURCE_DIR}/cmake/embed.cmake VERBATIM)
    target_sources(splatguard_tool PRIVATE ${PROJECT_BINARY_DIR}/${name}.c)
endforeach()
