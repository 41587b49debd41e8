# The Python package (docs/python.md): one extension on the stable ABI, which any CPython from 3.9 loads. It is built where
# headers of CPython 3.11 or newer are, which have the buffer protocol in the limited API.
option(SG_PYTHON "Build the Python package" ON)
set(SG_PYTHON_INCLUDE "" CACHE PATH "Folder of Python.h; empty = that of python3")
if(SG_PYTHON AND NOT SG_SANITIZE AND NOT SG_FUZZ) # a Python without sanitizers cannot load these
    find_program(SG_PYTHON_PROGRAM python3 PATHS /usr/bin NO_DEFAULT_PATH) # Debian's, before those of version managers
    find_program(SG_PYTHON_PROGRAM python3)
    set(include ${SG_PYTHON_INCLUDE})
    if(NOT include AND SG_PYTHON_PROGRAM)
        execute_process(COMMAND ${SG_PYTHON_PROGRAM} -c "import sysconfig; print(sysconfig.get_path('include'))"
            OUTPUT_VARIABLE include OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    endif()
    set(SG_PYTHON_VERSION 0)
    if(EXISTS ${include}/patchlevel.h)
        file(STRINGS ${include}/patchlevel.h line REGEX "define PY_VERSION ")
        string(REGEX MATCH "[0-9]+\\.[0-9]+" SG_PYTHON_VERSION "${line}")
    endif()
    if(SG_PYTHON_VERSION VERSION_LESS 3.11 OR CMAKE_CROSSCOMPILING)
        message(STATUS "Python package: left out, no headers of Python 3.11 or newer (scripts/setup python)")
    else()
        file(GLOB SG_PYTHON_SOURCES CONFIGURE_DEPENDS python/src/*.c)
        add_library(splatguard_python MODULE ${SG_PYTHON_SOURCES})
        target_include_directories(splatguard_python SYSTEM PRIVATE ${include})
        target_link_libraries(splatguard_python PRIVATE splatguard_internal sg_flags)
        set_target_properties(splatguard_python PROPERTIES PREFIX "" OUTPUT_NAME _core SUFFIX .abi3.so
            C_VISIBILITY_PRESET hidden LIBRARY_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/python/splatguard)
        target_link_options(splatguard_python PRIVATE -Wl,--exclude-libs,ALL)
        foreach(name __init__.py __init__.pyi py.typed)
            configure_file(python/splatguard/${name} ${CMAKE_CURRENT_BINARY_DIR}/python/splatguard/${name} COPYONLY)
        endforeach()
        if(BUILD_TESTING)
            add_test(NAME python COMMAND ${SG_PYTHON_PROGRAM} ${PROJECT_SOURCE_DIR}/python/tests/run.py)
            add_test(NAME python_tour COMMAND ${SG_PYTHON_PROGRAM} ${PROJECT_SOURCE_DIR}/python/tests/tour.py --check)
            set_tests_properties(python_tour PROPERTIES LABELS slow)
            set_tests_properties(python python_tour PROPERTIES SKIP_RETURN_CODE 77 TIMEOUT 900
                ENVIRONMENT "PYTHONPATH=${CMAKE_CURRENT_BINARY_DIR}/python;PYTHONDONTWRITEBYTECODE=1")
        endif()
    endif()
endif()
