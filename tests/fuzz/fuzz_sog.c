/* SPDX-License-Identifier: Apache-2.0 */
#include "fuzz/model_file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    read_model_file(".sog", data, size);
    return 0;
}
