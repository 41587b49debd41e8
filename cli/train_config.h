/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_TRAIN_CONFIG_H
#define CLI_TRAIN_CONFIG_H

#include "commands.h"

struct train_config {
    struct sg_run_params run;
    const char *proxy_of; /* the folder of the attack that this run is for, or NULL */
    bool resume, force, quiet;
    int threads;
};

#endif
