# The benchmark reaches below the public API. It is built always, so that it cannot rot. Tests run it for a moment.
add_executable(splatguard_bench bench/bench.c bench/roofline.c bench/stages.c)
if(SG_HAVE_VULKAN) # with kernels of its own, which measure what a device does at best
    target_sources(splatguard_bench PRIVATE bench/device.c)
    foreach(name device_copy device_issue)
        sg_spirv(${PROJECT_SOURCE_DIR}/bench/${name}.comp ${name})
        target_sources(splatguard_bench PRIVATE ${spirv_dir}/${name}.h)
    endforeach()
    target_include_directories(splatguard_bench PRIVATE ${spirv_dir} ${VULKAN_HEADERS})
else()
    target_sources(splatguard_bench PRIVATE bench/device_absent.c)
endif()
set_target_properties(splatguard_bench PROPERTIES OUTPUT_NAME bench)
target_include_directories(splatguard_bench PRIVATE src bench)
target_link_libraries(splatguard_bench PRIVATE splatguard_internal sg_flags sg_overrides Threads::Threads m)
target_compile_options(splatguard_bench PRIVATE -O3 -ffp-contract=fast)

# Our Fourier transforms next to FFTW's. FFTW is under the GPL: nothing but this program may link it.
pkg_check_modules(FFTW IMPORTED_TARGET fftw3f)
if(FFTW_FOUND)
    add_executable(splatguard_bench_fft bench/fft.c bench/fftw.c)
    set_target_properties(splatguard_bench_fft PROPERTIES OUTPUT_NAME bench_fft)
    target_include_directories(splatguard_bench_fft PRIVATE src bench)
    target_link_libraries(splatguard_bench_fft PRIVATE splatguard_internal sg_flags PkgConfig::FFTW Threads::Threads m)
    target_compile_options(splatguard_bench_fft PRIVATE -O3 -ffp-contract=fast)
endif()

# Registers and spills of the Vulkan engine's kernels, by a driver that compiles them.
if(SG_HAVE_VULKAN)
    add_executable(splatguard_registers bench/registers.c)
    set_target_properties(splatguard_registers PROPERTIES OUTPUT_NAME registers)
    target_include_directories(splatguard_registers PRIVATE src ${VULKAN_HEADERS})
    target_link_libraries(splatguard_registers PRIVATE splatguard_internal sg_flags)
endif()
