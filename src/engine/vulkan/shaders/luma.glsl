/* SPDX-License-Identifier: Apache-2.0 */
#include "math/spectrum.h"

const float luma[3] = {SG_LUMA};
