# src/engine/cpu/kernels/*.c are compiled once per instruction set; SG_ISA names the variant inside.
file(GLOB SG_KERNELS CONFIGURE_DEPENDS src/engine/cpu/kernels/*.c)

# Clang takes minutes to compile unrolled loops with checks of their pointers. Without these the address sanitizer still
# sees each access.
if(SG_SANITIZE MATCHES undefined AND CMAKE_C_COMPILER_ID MATCHES Clang)
    set(SG_UNROLLED -fno-sanitize=null,alignment,pointer-overflow)
endif()
# Transforms give the same bytes on every instruction set.
set_source_files_properties(${PROJECT_SOURCE_DIR}/src/engine/cpu/kernels/fft.c PROPERTIES COMPILE_OPTIONS "-ffp-contract=off;${SG_UNROLLED}")
set_source_files_properties(${PROJECT_SOURCE_DIR}/src/engine/cpu/kernels/neural.c PROPERTIES COMPILE_OPTIONS "${SG_UNROLLED}")
set(SG_KERNEL_LEVEL -O3)
if(SG_SANITIZE)
    set(SG_KERNEL_LEVEL -O2) # half the time to compile
endif()

function(sg_cpu_variant name)
    add_library(sg_kernels_${name} OBJECT ${SG_KERNELS})
    target_compile_definitions(sg_kernels_${name} PRIVATE SG_ISA=${name})
    target_compile_options(sg_kernels_${name} PRIVATE ${ARGN} ${SG_KERNEL_LEVEL} -ffp-contract=fast)
    target_include_directories(sg_kernels_${name} PRIVATE include src)
    target_link_libraries(sg_kernels_${name} PRIVATE sg_flags)
    set_target_properties(sg_kernels_${name} PROPERTIES POSITION_INDEPENDENT_CODE ON C_VISIBILITY_PRESET hidden)
    target_sources(splatguard PRIVATE $<TARGET_OBJECTS:sg_kernels_${name}>)
    list(APPEND SG_KERNEL_OBJECTS $<TARGET_OBJECTS:sg_kernels_${name}>)
    set(SG_KERNEL_OBJECTS ${SG_KERNEL_OBJECTS} PARENT_SCOPE)
endfunction()

if(SG_KERNELS)
    if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
        sg_cpu_variant(baseline)
        sg_cpu_variant(avx2 -mavx2 -mfma)
        sg_cpu_variant(avx512 -mavx512f -mavx512bw -mavx512dq -mavx512vl -mavx2 -mfma -mprefer-vector-width=512)
    elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64")
        sg_cpu_variant(neon)
    else()
        sg_cpu_variant(baseline)
    endif()
endif()
