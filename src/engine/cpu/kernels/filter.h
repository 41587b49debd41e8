/* SPDX-License-Identifier: Apache-2.0 */
/* Whether a file's kernels have the 2D filter of Mip-Splatting. Those of *_mip.c have it, and
 * include the file without it. This is decided at compile time, because a branch would change the
 * rounding of the usual kernels. */
#ifndef SG_KERNELS_FILTER_H
#define SG_KERNELS_FILTER_H

#ifdef SG_MIP
#define SG_COMPENSATED(v) true
#define VIEW(a) view_make_mip((a)->camera, (a)->mip_kernel)
#define GAIN(s) (s).gain
#define FILTERED(name) SG_PASTE(sg_cpu_##name##_mip, SG_ISA)
#else
#define SG_COMPENSATED(v) false
#define VIEW(a) view_make((a)->camera)
#define GAIN(s) r_set(1)
#define FILTERED(name) KERNEL(name)
#endif

#endif
