# The command line tool and its man page, which comes from the option tables. It includes public headers only: `src` is not
# in its path, and a test looks.
file(GLOB SG_TOOL_SOURCES CONFIGURE_DEPENDS cli/*.c)
add_executable(splatguard_tool ${SG_TOOL_SOURCES})
set_target_properties(splatguard_tool PROPERTIES OUTPUT_NAME splatguard)
target_link_libraries(splatguard_tool PRIVATE splatguard_internal sg_flags sg_overrides PkgConfig::JANSSON m)

if(NOT CMAKE_CROSSCOMPILING)
    add_custom_command(OUTPUT splatguard.1 COMMAND splatguard_tool help --man > splatguard.1 DEPENDS splatguard_tool VERBATIM)
    add_custom_target(man ALL DEPENDS splatguard.1)
endif()
