/* SPDX-License-Identifier: Apache-2.0 */
/* What an .spz file has within its gzip stream, so that changes get past the checksum; and where
 * the input begins with the mark of gzip, the stream itself. */
#include <zlib.h>

#include "fuzz/model_file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size > 1 && data[0] == 0x1f && data[1] == 0x8b) {
        read_model_file(".spz", data, size);
        return 0;
    }
    z_stream z = {0};
    if (size > 1 << 20 || deflateInit2(&z, 1, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY))
        return 0;
    uint8_t *packed = malloc(deflateBound(&z, size));
    z.next_in = (unsigned char *) (uintptr_t) data, z.avail_in = (unsigned) size;
    z.next_out = packed, z.avail_out = (unsigned) deflateBound(&z, size);
    if (!packed || deflate(&z, Z_FINISH) != Z_STREAM_END)
        abort();
    read_model_file(".spz", packed, z.total_out);
    deflateEnd(&z);
    free(packed);
    return 0;
}
