/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_ATTACK_CONFIG_H
#define CLI_ATTACK_CONFIG_H

#include "commands.h"

struct attack_config {
    struct sg_attack_run_params run;
    bool resume, force, quiet;
    int threads;
};

#endif
