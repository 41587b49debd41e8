/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_AUDIT_REPORT_H
#define CLI_AUDIT_REPORT_H

#include "splatguard/splatguard.h"

/* Writes the page. Returns an exit code after printing what is wrong. */
int audit_report(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_audit *audit,
                 const char *path);

#endif
