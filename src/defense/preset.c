/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "splatguard/defense.h"

bool sg_defense_preset(const char *name, struct sg_defense_params *p)
{
    static const struct {
        const char *name;
        double rho, lambda;
    } published[] = {{"ns", 0.03, 4}, {"tt", 0.045, 4}, {"mip", 0.05, 5}};
    for (size_t i = 0; i < sizeof(published) / sizeof(published[0]); i++)
        if (!strcmp(name, published[i].name)) {
            p->rho = published[i].rho, p->lambda = published[i].lambda;
            p->rho_least = 0, p->frequency = 8;
            p->view_weights = NULL;
            return true;
        }
    return false;
}
