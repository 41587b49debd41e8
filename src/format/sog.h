/* SPDX-License-Identifier: Apache-2.0 */
/* What reader and writer of .sog agree on. */
#ifndef SG_FORMAT_SOG_H
#define SG_FORMAT_SOG_H

#define SG_SOG_LARGEST 252 /* alpha of a rotation: this and the number of the largest component */
#define SG_SOG_PALETTE_ROW 64 /* vectors in a row of the palette's image */
#define SG_SOG_PALETTE_MAX 65536

#endif
