# Every tests/cli/*.sh drives the tool from a shell, in a folder of its own.
if(TARGET splatguard_tool)
    file(GLOB SG_CLI_TESTS CONFIGURE_DEPENDS tests/cli/*.sh)
    list(FILTER SG_CLI_TESTS EXCLUDE REGEX "/common\\.sh$")
    foreach(script ${SG_CLI_TESTS})
        get_filename_component(name ${script} NAME_WE)
        add_test(NAME cli_${name} COMMAND sh ${script} $<TARGET_FILE:splatguard_tool> ${PROJECT_SOURCE_DIR}
            ${PROJECT_BINARY_DIR}/cli-tests/${name})
        set_tests_properties(cli_${name} PROPERTIES SKIP_RETURN_CODE 77 TIMEOUT 900)
    endforeach()
    set_tests_properties(cli_train PROPERTIES LABELS threads)
    # The longest begin first, and these would be the last.
    set_tests_properties(cli_defense cli_train cli_view cli_train_view test_variants PROPERTIES COST 100)
    # The tables, links and texts of the last three are the same in every build.
    set_tests_properties(cli_end_to_end cli_killed cli_smoke cli_docs cli_tables cli_completion PROPERTIES LABELS slow)
endif()
