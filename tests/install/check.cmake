# cmake -DBUILD= -DPREFIX= -DSOURCE= -DCC= -DGENERATOR= -DSANITIZE= -DLIBDIR= -DVERSION= -P check.cmake
cmake_minimum_required(VERSION 3.25)
function(run) # stdout of the command in `out`; any failure ends the test
    execute_process(COMMAND ${ARGN} RESULT_VARIABLE rc OUTPUT_VARIABLE text ERROR_VARIABLE errors)
    if(NOT rc EQUAL 0)
        message(FATAL_ERROR "${ARGN}: ${rc}\n${text}${errors}")
    endif()
    string(STRIP "${text}" text)
    set(out "${text}" PARENT_SCOPE)
endfunction()

function(expect text pattern)
    if(NOT text MATCHES "${pattern}")
        message(FATAL_ERROR "found \"${text}\", expected ${pattern}")
    endif()
endfunction()

set(flags "")
if(SANITIZE)
    set(flags -fsanitize=${SANITIZE})
endif()

# The prefix is moved after installing, so that a path burnt into any installed file shows.
file(REMOVE_RECURSE ${PREFIX} ${PREFIX}.first)
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${PREFIX}.first)
file(RENAME ${PREFIX}.first ${PREFIX})

file(GLOB headers RELATIVE ${SOURCE}/include ${SOURCE}/include/splatguard/*.h)
foreach(header ${headers})
    if(NOT EXISTS ${PREFIX}/include/${header})
        message(FATAL_ERROR "${header} is not installed")
    endif()
endforeach()

set(ENV{PKG_CONFIG_PATH} ${PREFIX}/${LIBDIR}/pkgconfig)
set(ENV{LD_LIBRARY_PATH} ${PREFIX}/${LIBDIR})
run(pkg-config --modversion splatguard)
expect("${out}" "^${VERSION}$")
run(pkg-config --cflags --libs splatguard)
separate_arguments(package UNIX_COMMAND "${out}")

set(answer "^splatguard ${VERSION}: 1000 Gaussians$")
run(${CC} -std=c11 -Wall -Wextra -Werror ${flags} -o ${PREFIX}/first ${SOURCE}/tests/install/first.c ${package})
run(${PREFIX}/first)
expect("${out}" "${answer}")
run(${CC} -x c++ -Wall -Wextra -Werror ${flags} -o ${PREFIX}/first-cxx ${SOURCE}/tests/install/first.c -x none ${package})
run(${PREFIX}/first-cxx)
expect("${out}" "${answer}")

file(GLOB examples ${SOURCE}/examples/*.c)
foreach(example ${examples})
    get_filename_component(name ${example} NAME_WE)
    run(${CC} -std=c11 -Wall -Wextra -Werror ${flags} -o ${PREFIX}/examples-${name} ${example} ${package} -lm)
endforeach()
run(${PREFIX}/examples-render_from_memory ${PREFIX}/picture.ppm)
run(${PREFIX}/examples-scene_from_memory ${PREFIX}/ball.ply)
expect("${out}" "Gaussians, PSNR")

run(${CMAKE_COMMAND} -S ${SOURCE}/tests/install -B ${PREFIX}/user -G ${GENERATOR} -DCMAKE_C_COMPILER=${CC}
    -DCMAKE_PREFIX_PATH=${PREFIX} -DCMAKE_C_FLAGS=${flags})
run(${CMAKE_COMMAND} --build ${PREFIX}/user)
run(${PREFIX}/user/first)
expect("${out}" "${answer}")

# Another folder of headers: CMake refuses packages that name one that is not there.
run(${CMAKE_COMMAND} -S ${SOURCE} -B ${PREFIX}/other -G ${GENERATOR} -DCMAKE_C_COMPILER=${CC} -DBUILD_TESTING=OFF
    -DCMAKE_INSTALL_INCLUDEDIR=headers)
file(GLOB_RECURSE targets ${PREFIX}/other/CMakeFiles/Export/splatguard-targets.cmake)
file(STRINGS "${targets}" folders REGEX INTERFACE_INCLUDE_DIRECTORIES)
expect("${folders}" "\"\\\${_IMPORT_PREFIX}/headers\"$")

# The tool must find a shared library by itself.
unset(ENV{LD_LIBRARY_PATH})
run(${PREFIX}/bin/splatguard --version)
expect("${out}" "${VERSION}")
foreach(page splatguard splatguard-train splatguard-convert)
    file(READ ${PREFIX}/share/man/man1/${page}.1 man)
    expect("${man}" "\\.TH ")
endforeach()
foreach(completion bash-completion/completions/splatguard zsh/site-functions/_splatguard
        fish/vendor_completions.d/splatguard.fish)
    file(READ ${PREFIX}/share/${completion} script)
    expect("${script}" "--strategy|-l strategy")
endforeach()
file(REMOVE_RECURSE ${PREFIX})
