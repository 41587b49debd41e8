# Installed files: public headers, library, pkg-config file, CMake package, tool, man pages and completions.
include(CMakePackageConfigHelpers)

install(DIRECTORY include/splatguard DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h")
install(TARGETS splatguard EXPORT splatguard-targets
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
    INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})

# A static library drags its dependencies into every link, so they are then public requirements.
get_target_property(type splatguard TYPE)
set(SG_PC_REQUIRES "spng libturbojpeg libwebp jansson libxxhash")
if(ZLIB_FOUND)
    string(APPEND SG_PC_REQUIRES " zlib")
    set(SG_CONFIG_ZLIB ZLIB=zlib)
endif()
set(SG_PC_LIBS "-lm -pthread")
if(type STREQUAL "STATIC_LIBRARY")
    set(SG_PC_LINKAGE "Requires: ${SG_PC_REQUIRES}\nLibs: -L\${libdir} -lsplatguard ${SG_PC_LIBS}")
else()
    set(SG_PC_LINKAGE "Requires.private: ${SG_PC_REQUIRES}\nLibs: -L\${libdir} -lsplatguard\nLibs.private: ${SG_PC_LIBS}")
endif()

# Paths relative to the .pc file: the tree may be installed with another prefix, or moved.
if(IS_ABSOLUTE "${CMAKE_INSTALL_LIBDIR}" OR IS_ABSOLUTE "${CMAKE_INSTALL_INCLUDEDIR}")
    set(SG_PC_PREFIX "${CMAKE_INSTALL_PREFIX}")
    set(SG_PC_LIBDIR "${CMAKE_INSTALL_FULL_LIBDIR}")
    set(SG_PC_INCLUDEDIR "${CMAKE_INSTALL_FULL_INCLUDEDIR}")
else()
    file(RELATIVE_PATH up "/p/${CMAKE_INSTALL_LIBDIR}/pkgconfig" "/p")
    string(REGEX REPLACE "/$" "" up "${up}")
    set(SG_PC_PREFIX "\${pcfiledir}/${up}")
    set(SG_PC_LIBDIR "\${prefix}/${CMAKE_INSTALL_LIBDIR}")
    set(SG_PC_INCLUDEDIR "\${prefix}/${CMAKE_INSTALL_INCLUDEDIR}")
endif()
configure_file(cmake/splatguard.pc.in splatguard.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/splatguard.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/splatguard)
install(EXPORT splatguard-targets NAMESPACE splatguard:: DESTINATION ${package_dir})
configure_package_config_file(cmake/splatguard-config.cmake.in splatguard-config.cmake INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(splatguard-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/splatguard-config.cmake ${PROJECT_BINARY_DIR}/splatguard-config-version.cmake
    DESTINATION ${package_dir})

if(TARGET splatguard_tool)
    if(NOT type STREQUAL "STATIC_LIBRARY" AND NOT IS_ABSOLUTE "${CMAKE_INSTALL_LIBDIR}")
        file(RELATIVE_PATH lib "/p/${CMAKE_INSTALL_BINDIR}" "/p/${CMAKE_INSTALL_LIBDIR}")
        set_target_properties(splatguard_tool PROPERTIES INSTALL_RPATH "$ORIGIN/${lib}")
    endif()
    install(TARGETS splatguard_tool RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
if(TARGET man)
    set(SG_ZSH_COMPLETIONS ${CMAKE_INSTALL_DATADIR}/zsh/site-functions CACHE STRING "Where zsh looks for completions")
    install(DIRECTORY ${PROJECT_BINARY_DIR}/man/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 FILES_MATCHING PATTERN "*.1")
    set(completions ${PROJECT_BINARY_DIR}/completions)
    install(FILES ${completions}/bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME splatguard)
    install(FILES ${completions}/zsh DESTINATION ${SG_ZSH_COMPLETIONS} RENAME _splatguard)
    install(FILES ${completions}/fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d RENAME splatguard.fish)
endif()
