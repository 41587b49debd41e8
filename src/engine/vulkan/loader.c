/* SPDX-License-Identifier: Apache-2.0 */
#include "loader.h"

#include <dlfcn.h>
#include <pthread.h>
#include <stdbool.h>
#include <unistd.h>

/* dlsym returns an object's pointer; POSIX lets it be a function's. */
#define LOAD(target, source)                                                                       \
    do {                                                                                           \
        const void *from_ = (const void *) (source);                                               \
        *(const void **) &(target) = from_;                                                        \
    } while (0)

/* The loader and its instance of this process, once somebody has asked. */
static struct {
    pthread_mutex_t lock;
    struct vk_functions vk; /* library NULL: nobody has, or there is none */
    pid_t process;
} opened = {.lock = PTHREAD_MUTEX_INITIALIZER};

static const char *open_loader(struct vk_functions *vk)
{
    *vk = (struct vk_functions){0};
    static const char *const names[] = {"libvulkan.so.1", "libvulkan.so", "libvulkan.1.dylib",
                                        "libMoltenVK.dylib"};
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]) && !vk->library; i++)
        vk->library = dlopen(names[i], RTLD_NOW | RTLD_LOCAL);
    if (!vk->library)
        return "the Vulkan loader (libvulkan.so.1, package libvulkan1; see docs/gpu.md)";
    LOAD(vk->GetInstanceProcAddr, dlsym(vk->library, "vkGetInstanceProcAddr"));
    const char *missing = "a working Vulkan loader";
    if (vk->GetInstanceProcAddr) {
#define F(name) LOAD(vk->name, vk->GetInstanceProcAddr(NULL, "vk" #name));
        VK_GLOBAL_FUNCTIONS(F)
#undef F
        uint32_t version = 0;
        const VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                               .pApplicationName = "splatguard",
                                               .apiVersion = VK_API_VERSION_1_2};
        const VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                           .pApplicationInfo = &application};
        if (!vk->EnumerateInstanceVersion || !vk->CreateInstance ||
            vk->EnumerateInstanceVersion(&version) || version < VK_API_VERSION_1_2)
            missing = "a Vulkan loader of version 1.2 or newer";
        else if (vk->CreateInstance(&info, NULL, &vk->instance))
            missing =
                "a Vulkan driver that starts (mesa-vulkan-drivers; or NVIDIA's with libegl1, in a "
                "container with the capability graphics; see docs/gpu.md)";
        else
            missing = NULL;
    }
    if (missing) {
        dlclose(vk->library);
        *vk = (struct vk_functions){0};
        return missing;
    }
#define F(name) LOAD(vk->name, vk->GetInstanceProcAddr(vk->instance, "vk" #name));
    VK_INSTANCE_FUNCTIONS(F)
#undef F
    return NULL;
}

const char *sg_vk_open(struct vk_functions *vk)
{
    pthread_mutex_lock(&opened.lock);
    const bool is_open = opened.vk.library && opened.process == getpid();
    const char *missing = is_open ? NULL : open_loader(&opened.vk);
    opened.process = getpid();
    *vk = opened.vk;
    pthread_mutex_unlock(&opened.lock);
    return missing;
}

void sg_vk_open_device(struct vk_functions *vk, VkDevice device)
{
#define F(name) LOAD(vk->name, vk->GetDeviceProcAddr(device, "vk" #name));
    VK_DEVICE_FUNCTIONS(F)
#undef F
}
