/* SPDX-License-Identifier: Apache-2.0 */
/* project.c with the 2D filter of Mip-Splatting. */
#define SG_MIP
#include "project.c"
