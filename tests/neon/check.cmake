# Compiles kernels, engines, core and transforms for aarch64 with the tests that compare them with the oracles, and runs
# those.
set(flags -std=gnu11 -Wall -Wextra -Werror -Wno-psabi -fno-math-errno -fno-trapping-math -D_GNU_SOURCE
    -DSG_VERSION="${VERSION}" -I${SOURCE}/tests/neon -I${SOURCE}/include -I${SOURCE}/src -I${SOURCE}/tests)
file(REMOVE_RECURSE ${BUILD})

# compile(FOLDER FLAGS... SOURCES...): a folder each, because files of two folders may have one name.
function(compile folder)
    file(MAKE_DIRECTORY ${BUILD}/${folder})
    execute_process(COMMAND ${CC} ${flags} -c ${ARGN} WORKING_DIRECTORY ${BUILD}/${folder} COMMAND_ERROR_IS_FATAL ANY)
endfunction()

set(fft ${SOURCE}/src/engine/cpu/kernels/fft.c)
file(GLOB kernels ${SOURCE}/src/engine/cpu/kernels/*.c)
list(REMOVE_ITEM kernels ${fft})
file(GLOB sources ${SOURCE}/src/core/*.c ${SOURCE}/src/engine/*.c ${SOURCE}/src/engine/host/*.c
    ${SOURCE}/src/engine/ref/*.c ${SOURCE}/src/engine/cpu/*.c ${SOURCE}/src/engine/scaffold/*.c
    ${SOURCE}/src/engine/vulkan/absent.c ${SOURCE}/src/spectral/*.c)
list(REMOVE_ITEM sources ${SOURCE}/src/core/json_text.c) # there is no jansson for the emulated machine
compile(kernels -DSG_ISA=neon -O3 -ffp-contract=fast ${kernels})
compile(fft -DSG_ISA=neon -O3 -ffp-contract=off ${fft})
compile(library -O2 -ffp-contract=off ${sources} ${SOURCE}/src/model/store.c ${SOURCE}/src/model/init.c ${SOURCE}/src/model/anchors.c
    ${SOURCE}/src/model/nearest.c ${SOURCE}/src/model/columns.c ${SOURCE}/src/model/morton.c ${SOURCE}/src/image/total_variation.c
    ${SOURCE}/src/image/variation.c ${SOURCE}/src/image/ssim.c)
file(GLOB objects ${BUILD}/*/*.o)

# run(SOURCES...): a test program.
function(run)
    execute_process(COMMAND ${CC} ${flags} -O2 -ffp-contract=off ${ARGN} ${objects} -static -pthread -lm
        -o ${BUILD}/program COMMAND_ERROR_IS_FATAL ANY)
    execute_process(COMMAND ${QEMU} ${BUILD}/program COMMAND_ERROR_IS_FATAL ANY)
endfunction()

file(GLOB checks ${SOURCE}/tests/kernels/*.c)
run(${checks})
foreach(test engine/test_engine engine/test_operations engine/test_gaussians test_fft)
    run(${SOURCE}/tests/${test}.c)
endforeach()
