# Compiles kernels, engines and core for aarch64 with the tests that compare them with the oracle, and runs those.
file(GLOB kernels ${SOURCE}/src/engine/cpu/kernels/*.c)
file(GLOB sources ${SOURCE}/src/core/*.c ${SOURCE}/src/engine/*.c ${SOURCE}/src/engine/host/*.c
    ${SOURCE}/src/engine/ref/*.c ${SOURCE}/src/engine/cpu/*.c ${SOURCE}/src/spectral/*.c)
list(REMOVE_ITEM sources ${SOURCE}/src/core/json_text.c) # there is no jansson for the emulated machine
list(REMOVE_ITEM kernels ${SOURCE}/src/engine/cpu/kernels/fft.c)
set(flags -std=gnu11 -O2 -Wall -Wextra -Werror -Wno-psabi -fno-math-errno -fno-trapping-math -D_GNU_SOURCE
    -DSG_VERSION="${VERSION}" -I${SOURCE}/tests/neon -I${SOURCE}/include -I${SOURCE}/src -I${SOURCE}/tests)
file(MAKE_DIRECTORY ${BUILD})
execute_process(COMMAND ${CC} ${flags} -DSG_ISA=neon -O3 -ffp-contract=fast -c ${kernels} WORKING_DIRECTORY ${BUILD}
    COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CC} ${flags} -DSG_ISA=neon -O3 -ffp-contract=off -c ${SOURCE}/src/engine/cpu/kernels/fft.c
    WORKING_DIRECTORY ${BUILD} COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CC} ${flags} -ffp-contract=off -c ${sources} ${SOURCE}/src/model/store.c
    ${SOURCE}/src/model/init.c ${SOURCE}/src/model/nearest.c WORKING_DIRECTORY ${BUILD}
    COMMAND_ERROR_IS_FATAL ANY)
set(objects)
foreach(source ${kernels} ${sources} fft.c store.c init.c nearest.c)
    get_filename_component(name ${source} NAME_WLE)
    list(APPEND objects ${BUILD}/${name}.o)
endforeach()
foreach(test engine/test_engine engine/test_operations test_kernels test_fft)
    execute_process(COMMAND ${CC} ${flags} -ffp-contract=off ${SOURCE}/tests/${test}.c ${objects} -static -pthread -lm
        -o ${BUILD}/program COMMAND_ERROR_IS_FATAL ANY)
    execute_process(COMMAND ${QEMU} ${BUILD}/program COMMAND_ERROR_IS_FATAL ANY)
endforeach()
