/* SPDX-License-Identifier: Apache-2.0 */
/* learn.c with the 2D filter of Mip-Splatting. */
#define SG_MIP
#include "learn.c"
