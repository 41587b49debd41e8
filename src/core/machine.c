/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>
#include <sys/utsname.h>

#include "splatguard/engine.h"

void sg_machine_name(char *name, size_t size)
{
    struct utsname u;
    char line[256];
    bool found = false;
    FILE *f = fopen("/proc/cpuinfo", "re");
    while (f && !found && fgets(line, sizeof(line), f)) {
        const char *value = line + strcspn(line, ":");
        value += strspn(value, ": \t");
        line[strcspn(line, "\n")] = 0;
        if ((found = *value && !strncmp(line, "model name", 10)))
            snprintf(name, size, "%s", value);
    }
    if (f)
        fclose(f);
    if (!found)
        snprintf(name, size, "%s", uname(&u) ? "unknown" : u.machine);
}
