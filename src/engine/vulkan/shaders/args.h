/* SPDX-License-Identifier: Apache-2.0 */
/* What the host and the kernels agree on, for C and GLSL: every kernel's arguments (its push
 * constants, at most 128 bytes) as a list of P(type, name), a buffer's address, U(name), an
 * unsigned number, and F(name), a float. */
#ifndef SG_VULKAN_ARGS_H
#define SG_VULKAN_ARGS_H

#define VK_BATCH 32         /* instances staged at once */
#define VK_CHUNK 128        /* instances between two checkpoints: a unit of the backward pass */
#define VK_BLOCKS 8         /* of 8 x 4 pixels in a tile */
#define VK_BLOCK_SIZE 32    /* pixels */
#define VK_SPLAT 16         /* floats of a projected Gaussian */
#define VK_SLOT 9           /* floats: sum w, w dx, w dy, w dx^2, w dx dy, w dy^2, r, g, b */
#define VK_SLOT_ABSOLUTE 11 /* and, where absolute gradients are counted, |dL/dx|, |dL/dy| */
#define VK_GROUP 256        /* invocations of the kernels without a tile */
#define VK_SCAN 2048        /* numbers that a workgroup scans */
#define VK_SORT 1024        /* keys that a workgroup sorts */
#define VK_SORT_GROUP 64    /* invocations: each sorts VK_SORT / VK_SORT_GROUP keys in order */
#define VK_DIGITS 256
#define VK_LINE 2016       /* points of a Fourier transform in shared memory */
#define VK_LINE_GROUP 128  /* invocations that transform a line */
#define VK_LINE_GROUPS 128 /* workgroups with longer lines */

/* Words of a unit: the lists of its batches' blocks, and its tile. */
#define VK_UNIT (VK_CHUNK / VK_BATCH * VK_BLOCKS + 1)
#define VK_UNIT_TILE (VK_UNIT - 1)

/* Numbers that kernels leave for the host; pairs are low and high words. */
#define VK_RESULT_VISIBLE 0
#define VK_RESULT_INSTANCES 2
#define VK_RESULT_PAIRS 4
#define VK_RESULT_LONGEST 6
/* Floats: 3 of the photometric loss, one of the total variation, one of the low-pass term; and the
 * gradient of the exposure. */
#define VK_RESULT_LOSSES 8
#define VK_RESULT_VARIATION 13 /* a float: of an ascended image */
#define VK_RESULT_EXPOSURE 16
#define VK_RESULT_ENERGY 28 /* of the spectrum, by direction: at most 254 floats */
#define VK_RESULTS 282

/* Work of later kernels, which the device counts: of each item the workgroups in three dimensions,
 * and what they work on. Once the device has stopped, those that change the model and those of
 * instances have no workgroups. */
#define VK_WORK_WORDS 4
#define VK_WORK_ITEMS 3      /* the word with the number of items */
#define VK_WORK_MODEL 0      /* Gaussians, of kernels that change the model or count in it */
#define VK_WORK_DRAWN 1      /* Gaussians that are drawn */
#define VK_WORK_DRAWN_SORT 2 /* the same, in groups that are sorted or scanned, */
#define VK_WORK_DRAWN_SCAN 3
#define VK_WORK_DRAWN_DIGITS 4 /* and the counters of their digits */
#define VK_WORK_EMIT 5         /* drawn Gaussians whose instances have room */
#define VK_WORK_SORT 6         /* instances; their counters */
#define VK_WORK_DIGITS 7
#define VK_WORK_STARTS 8 /* one more workgroup may be needed than for the instances */
#define VK_WORK_TILES 9
#define VK_WORK_UNITS 10 /* of the backward pass */
#define VK_WORK_ALL 11   /* Gaussians: a number only, from the host */
#define VK_WORKS 12
#define VK_MOST_GROUPS 65535        /* of a dimension, on every device */
#define VK_MOST_INDEX 0x7fffffff    /* of an array: SPIR-V takes indices for signed numbers */
#define VK_MOST_INSTANCES (1 << 27) /* held at once: of slots, units and checkpoints */

/* Bits of the specialisation constant WITHOUT: parts of a kernel that the benchmark leaves out. */
#define VK_WITHOUT_COLOURS 1    /* project: spherical harmonics */
#define VK_WITHOUT_SPLATS 2     /* project: ellipses, and writing splats */
#define VK_WITHOUT_PAIRS 4      /* raster, raster_backward: pairs of a Gaussian and a pixel */
#define VK_WITHOUT_WRITES 8     /* raster: the image and the states of its pixels */
#define VK_WITHOUT_SUMS 16      /* raster_backward: sums over pixels and blocks */
#define VK_WITHOUT_SLOTS 32     /* raster_backward: writing the sums */
#define VK_WITHOUT_GRADIENTS 64 /* learn: sums of slots, and gradients from them */
#define VK_WITHOUT_STEPS 128    /* learn: parameters and moments */

#define VK_KERNELS(K)                                                                              \
    K(project)                                                                                     \
    K(count)                                                                                       \
    K(size)                                                                                        \
    K(tile_totals)                                                                                 \
    K(scan_sum)                                                                                    \
    K(scan_apply)                                                                                  \
    K(compact)                                                                                     \
    K(gather)                                                                                      \
    K(radix_count)                                                                                 \
    K(radix_scatter)                                                                               \
    K(emit)                                                                                        \
    K(tile_start)                                                                                  \
    K(tile_chunks)                                                                                 \
    K(raster)                                                                                      \
    K(raster_backward)                                                                             \
    K(raster_count)                                                                                \
    K(slots_add)                                                                                   \
    K(learn)                                                                                       \
    K(target)                                                                                      \
    K(ssim)                                                                                        \
    K(ssim_gradient)                                                                               \
    K(low_pass)                                                                                    \
    K(low_pass_gradient)                                                                           \
    K(expose)                                                                                      \
    K(expose_backward)                                                                             \
    K(learn_exposures)                                                                             \
    K(spectrum_rows)                                                                               \
    K(spectrum_columns)                                                                            \
    K(spectrum_factors)                                                                            \
    K(spectrum_columns_back)                                                                       \
    K(spectrum_rows_back)                                                                          \
    K(total_variation)                                                                             \
    K(loss_sums)                                                                                   \
    K(ascend)                                                                                      \
    K(magnitudes)                                                                                  \
    K(ascent_begin)                                                                                \
    K(variation)                                                                                   \
    K(move)                                                                                        \
    K(relocate)                                                                                    \
    K(explore)                                                                                     \
    K(mip_shape)                                                                                   \
    K(mip_depth)                                                                                   \
    K(mip_filter)                                                                                  \
    K(planes)                                                                                      \
    K(radii)                                                                                       \
    K(edit)                                                                                        \
    K(anchors_see)                                                                                 \
    K(anchors_list)                                                                                \
    K(neural)                                                                                      \
    K(neural_backward)                                                                             \
    K(piece_sums)                                                                                  \
    K(neural_look)                                                                                 \
    K(anchors_count)                                                                               \
    K(anchors_learn)                                                                               \
    K(networks_learn)

/* clang-format off */
#define ARGS_project(P, U, F)                                                                      \
    P(Floats, params) P(Floats, view) P(Floats, splats) P(Uints, rects) P(Uints, keys)             \
    P(Uints, flags) P(Uints, results) U(count) U(planes) U(grid_x) U(grid_y)

/* Tiles first to end - 1, in row-major order, are the band. */
#define ARGS_count(P, U, F)                                                                        \
    P(Floats, splats) P(Uints, rects) P(Uints, counts) P(Uints, results) U(count) U(grid_x)        \
    U(first) U(end) U(reference_tiles)
#define ARGS_tile_totals(P, U, F)                                                                  \
    P(Floats, splats) P(Uints, rects) P(Uints, totals) U(count) U(grid_x) U(tiles)                 \
    U(reference_tiles)

/* Sizes of the work, in one workgroup. what: of the drawn Gaussians, whose number `total` points
 * to; of the instances of a band, where more than `capacity` stop the device; of the units of the
 * backward pass; or nothing, but `most` becomes the largest number of instances of all views that
 * come so far. count, tiles: of the model, of the band. whole: 1 = it is the whole image. */
#define VK_SIZE_DRAWN 0
#define VK_SIZE_INSTANCES 1
#define VK_SIZE_UNITS 2
#define VK_SIZE_MOST 3
#define ARGS_size(P, U, F)                                                                         \
    P(Uints, work) P(Uints, stop) P(Uints, results) P(Uints, total) P(Uints, most) U(what)         \
    U(count) U(tiles) U(whole) U(capacity)

/* Exclusive sums of `from` to `to`; the sum of all goes to to[count]. count: one number. */
#define ARGS_scan(P, U, F)                                                                         \
    P(Uints, from) P(Uints, to) P(Uints, sums) P(Uints, count)
#define ARGS_scan_sum ARGS_scan
#define ARGS_scan_apply ARGS_scan

#define ARGS_compact(P, U, F)                                                                      \
    P(Uints, flags) P(Uints, places) P(Uints, keys) P(Uints, to_keys) P(Uints, to_values)          \
    U(count)
#define ARGS_gather(P, U, F)                                                                       \
    P(Uints, from) P(Uints, index) P(Uints, to) P(Uints, count)
#define ARGS_radix_count(P, U, F)                                                                  \
    P(Uints, keys) P(Uints, digits) P(Uints, count) U(shift)
#define ARGS_radix_scatter(P, U, F)                                                                \
    P(Uints, keys) P(Uints, values) P(Uints, digits) P(Uints, to_keys) P(Uints, to_values)         \
    P(Uints, count) U(shift)
#define ARGS_emit(P, U, F)                                                                         \
    P(Floats, splats) P(Uints, rects) P(Uints, order) P(Uints, places) P(Uints, slot_start)        \
    P(Uints, keys) P(Uints, values) P(Uints, emitted) P(Uints, count) U(grid_x) U(first) U(end)    \
    U(reference_tiles)
#define ARGS_tile_start(P, U, F)                                                                   \
    P(Uints, keys) P(Uints, values) P(Uints, emitted) P(Uints, instances) P(Uints, tile_start)     \
    P(Uints, count) U(tiles)
#define ARGS_tile_chunks(P, U, F)                                                                  \
    P(Uints, tile_start) P(Uints, chunks) P(Uints, results) U(tiles)

/* auxiliary: 1 = alpha and depth too */
#define ARGS_raster(P, U, F)                                                                       \
    P(Floats, splats) P(Uints, instances) P(Uints, tile_start) P(Uints, chunk_start)               \
    P(Uints, units) P(Uints, reached) P(Floats, checkpoints) P(Floats, image) P(Floats, alpha)     \
    P(Floats, depth) P(Uints, results) U(first_tile) U(tiles) U(grid_x) U(width) U(height)         \
    U(auxiliary) F(background_r) F(background_g) F(background_b)
#define ARGS_raster_backward(P, U, F)                                                              \
    P(Floats, splats) P(Uints, instances) P(Uints, tile_start) P(Uints, chunk_start)               \
    P(Uints, units) P(Uints, reached) P(Floats, checkpoints) P(Floats, image)                      \
    P(Floats, gradient) P(Floats, slots) U(first_tile) U(tiles) U(grid_x) U(width) U(height)
/* hit: enum sg_hit, of which two are no numbers of pixels. */
#define VK_HIT_WEIGHT 2
#define VK_HIT_TRANSMITTANCE 3
#define ARGS_raster_count(P, U, F)                                                                 \
    P(Floats, splats) P(Uints, instances) P(Uints, tile_start) P(Floats, slots) U(first_tile)      \
    U(tiles) U(grid_x) U(width) U(height) U(hit)
/* Adds each Gaussian's slots of `width` floats to its sums. */
#define ARGS_slots_add(P, U, F)                                                                    \
    P(Floats, slots) P(Uints, slot_start) P(Floats, sums) U(count) U(width)

/* Bits of `what`. */
#define VK_LEARN_PULL 1 /* gradients from the slots; else they are read */
#define VK_LEARN_STORE 2
#define VK_LEARN_STATISTICS 4
#define VK_LEARN_ACCUMULATE 8
#define VK_LEARN_ADAM 16
#define VK_LEARN_BANDED 32   /* slots: sums over the bands, one a Gaussian */
#define VK_LEARN_ABSOLUTE 64 /* slots have absolute gradients: they are the statistic, */
#define VK_LEARN_BESIDE 128  /* or are added up in grad_absolute, beside the norm */
/* Of the buffer `view`: the view, then the step: 6 rates, 6 roots (enum sg_group), mean_opacity,
 * mean_scale. */
#define VK_VIEW 27
#define VK_STEP 14
#define ARGS_learn(P, U, F)                                                                        \
    P(Floats, shaped) P(Floats, params) P(Floats, m) P(Floats, v) P(Floats, grad_sum)              \
    P(Floats, grad_count) P(Floats, grad_absolute) P(Floats, gradients) P(Floats, accumulated)     \
    P(Floats, splats) P(Uints, rects) P(Floats, slots) P(Uints, slot_start) P(Floats, view)        \
    U(count) U(planes) U(what)

/* photo: a word a pixel, red in the lowest byte, the mask in the highest. planes: 1 = `planes` are
 * the target; masked: 1 = there is a mask. */
#define ARGS_target(P, U, F)                                                                       \
    P(Uints, photo) P(Floats, given) P(Floats, image) P(Floats, target) U(pixels) U(planes)        \
    U(masked) F(tolerance)
#define ARGS_ssim(P, U, F)                                                                         \
    P(Floats, image) P(Floats, target) P(Floats, maps) P(Floats, sums) U(width) U(height)
#define ARGS_ssim_gradient(P, U, F)                                                                \
    P(Floats, image) P(Floats, target) P(Floats, maps) P(Uints, photo) P(Floats, gradient)         \
    U(width) U(height) U(masked) U(tolerant) F(l1) F(dssim)
/* passed: what the first leaves for the second. */
#define ARGS_low_pass(P, U, F)                                                                     \
    P(Floats, image) P(Uints, photo) P(Floats, given) P(Floats, passed) P(Floats, sums) U(width)   \
    U(height) U(planes) U(masked) F(tolerance)
#define ARGS_low_pass_gradient(P, U, F)                                                            \
    P(Floats, image) P(Uints, photo) P(Floats, given) P(Floats, passed) P(Floats, gradient)        \
    U(width) U(height) U(planes) U(masked) F(tolerance) F(scale)
#define ARGS_expose(P, U, F)                                                                       \
    P(Floats, image) P(Floats, exposed) P(Floats, exposure) U(pixels)
#define ARGS_expose_backward(P, U, F)                                                              \
    P(Floats, image) P(Floats, gradient) P(Floats, sums) P(Floats, exposure) U(pixels)
/* A step of all exposures, unless the device has stopped. exposures: `count` of them, then their
 * moments. gradient: of the one with this number. */
#define ARGS_learn_exposures(P, U, F)                                                              \
    P(Floats, exposures) P(Floats, gradient) P(Uints, stop) U(count) U(number) F(rate) F(root)
/* Words of a Fourier transform's plan, and behind them, with the index of a word, its tables:
 * points of the stages, their number, factors of Bluestein's chirp and of its filter (0: none), and
 * for each stage its radix, the points of its parts, twiddles and roots. */
#define VK_FFT_POINTS 0
#define VK_FFT_STAGES 1
#define VK_FFT_CHIRP 2
#define VK_FFT_FILTER 3
#define VK_FFT_HEADER 4
/* points, rows: of the transformed image along the lines, and its height; width, height: of the
 * image. Workgroups take line after line. room: for lines of more than VK_LINE points, the longest
 * of which has `longest`. */
#define ARGS_spectrum_rows(P, U, F)                                                                \
    P(Floats, image) P(Floats, spectrum) P(Uints, plan) P(Floats, tables) P(Floats, room) U(width) \
    U(height) U(points) U(rows) U(columns) U(planes) U(groups) U(longest)
#define ARGS_spectrum_columns(P, U, F)                                                             \
    P(Floats, spectrum) P(Uints, directions) P(Floats, energy) P(Uints, plan) P(Floats, tables)    \
    P(Floats, room) U(height) U(points) U(columns) U(planes) U(bins) U(amplitude) U(groups)        \
    U(longest)
#define ARGS_spectrum_factors(P, U, F)                                                             \
    P(Floats, energy) P(Floats, factors) U(bins) F(least) F(weight)
#define ARGS_spectrum_columns_back(P, U, F)                                                        \
    P(Floats, spectrum) P(Uints, directions) P(Floats, factors) P(Uints, plan) P(Floats, tables)   \
    P(Floats, room) U(height) U(points) U(columns) U(planes) U(amplitude) U(groups) U(longest)
#define ARGS_spectrum_rows_back(P, U, F)                                                           \
    P(Floats, gradient) P(Uints, photo) P(Floats, spectrum) P(Uints, plan) P(Floats, tables)       \
    P(Floats, room) U(width) U(height) U(points) U(rows) U(columns) U(planes) U(masked) U(groups)  \
    U(longest)
/* norm: enum sg_tv_penalty. Adds `across` and `down` times the slopes to the gradient. */
#define ARGS_total_variation(P, U, F)                                                              \
    P(Floats, image) P(Uints, photo) P(Floats, gradient) P(Floats, sums) U(width) U(height)        \
    U(masked) U(norm) F(across) F(down) F(weight) F(edge)
/* form of a total variation, as in enum sg_attack_tv */
#define VK_TV_VERTICAL2 0
#define VK_TV_ANISO 1
#define VK_TV_ISO 2
/* form: VK_TV_. bounded: 1 = `bound` has each pixel's epsilon; more: 1 = the step goes
 * down `extra` too, whose absolute values have the sum `magnitude` and get the sum `weight`. */
#define ARGS_ascend(P, U, F)                                                                       \
    P(Floats, photo) P(Floats, from) P(Floats, bound) P(Floats, extra) P(Floats, magnitude)        \
    P(Floats, to) U(width) U(height) U(form) U(bounded) U(more) F(epsilon) F(size) F(weight)
/* The photo's values, and the image, clamped to [0, 1] or as it is. */
#define ARGS_ascent_begin(P, U, F)                                                                 \
    P(Uints, photo) P(Floats, image) P(Floats, values) P(Floats, to) U(pixels) U(clamped)
/* Sums of the total variation over groups. */
#define ARGS_variation(P, U, F)                                                                    \
    P(Floats, image) P(Floats, sums) U(width) U(height) U(form)
/* Sums of absolute values over groups. */
#define ARGS_magnitudes(P, U, F)                                                                   \
    P(Floats, from) P(Floats, sums) U(count)
/* Sums `width` floats of `count` groups, in a fixed order: a workgroup each. */
#define ARGS_loss_sums(P, U, F)                                                                    \
    P(Floats, from) P(Floats, to) U(count) U(width)
/* Changes of the parameters in place: 0 = scales to at least `limit`, as stored; 1 = opacity to at
 * most `limit`, as stored; 2 = the same as it is drawn, in `shaped`, both activated. With 1 and 2
 * the moments of the opacity become 0, where there are some. */
#define ARGS_move(P, U, F)                                                                         \
    P(Floats, params) P(Floats, shaped) P(Floats, m) P(Floats, v) U(count) U(planes) U(what)       \
    U(moments) F(limit)
/* Entries `first` to `end` - 1 of a struct sg_relocation, none of which reads what another one
 * writes. Words of an entry: to, from, bits of the opacity and of what is added to the scales,
 * fresh. */
#define VK_ENTRY 5
#define ARGS_relocate(P, U, F)                                                                     \
    P(Floats, params) P(Floats, m) P(Floats, v) P(Uints, entries) U(first) U(end) U(planes)        \
    U(moments)
/* The noise of a struct sg_exploration. key: seed and stream, mixed, in two words. */
#define ARGS_explore(P, U, F)                                                                      \
    P(Floats, params) U(count) U(planes) U(key_low) U(key_high) F(amount) F(gate) F(dead)
/* What Gaussians with a 3D filter are drawn as, to a copy of the parameters; back: 1 = the gradient
 * of that to the one of the parameters. */
#define ARGS_mip_shape(P, U, F)                                                                    \
    P(Floats, params) P(Floats, filters) P(Floats, to) U(count) U(planes) U(back)
/* The least depth in the cameras that see a Gaussian (math/mip.h), and behind these the largest of
 * them, which begins as 0. */
#define ARGS_mip_depth(P, U, F)                                                                    \
    P(Floats, params) P(Floats, cameras) P(Floats, depths) P(Uints, most) U(count) U(planes)       \
    U(views) F(margin)
#define ARGS_mip_filter(P, U, F)                                                                   \
    P(Floats, depths) P(Floats, filters) U(count) F(focal) F(pixels)
/* The first `width` of the `planes` planes of every Gaussian, to an array of so many planes. */
#define ARGS_planes(P, U, F)                                                                       \
    P(Floats, from) P(Floats, to) U(count) U(planes) U(width)
/* Raises each Gaussian's radius to that in the view, unless the device has stopped. */
#define ARGS_radii(P, U, F)                                                                        \
    P(Floats, params) P(Floats, view) P(Floats, radii) P(Uints, stop) U(count) U(planes) U(grid_x) \
    U(grid_y)
/* moves: of every row two words: the source, an index before the edit or a row of the caller's; and
 * the kind (enum sg_edit_kind), with a child's number above its bits. fates: by kind, what the
 * planes from `first` to `end` - 1 take. children: the planes up to the rotation. */
#define VK_KIND_BITS 2
#define VK_FATE_ZERO 0
#define VK_FATE_COPY 1
#define VK_FATE_ROW 2
#define VK_FATE_CHILD 3
#define VK_FATE_BITS 2
#define VK_FATE_MASK 3
#define ARGS_edit(P, U, F)                                                                         \
    P(Floats, from) P(Floats, rows) P(Floats, children) P(Uints, moves) P(Floats, to) U(count)     \
    U(planes) U(first) U(end) U(fates)

/* ---- anchors ---- */

/* As in model/anchor.h, and places of struct sg_weights. */
#define VK_ANCHOR 10 /* Gaussians of an anchor: number k of anchor i is Gaussian 10 i + k */
#define VK_A_FEATURES 32
#define VK_A_FEATURE 30
#define VK_A_SIZE 62
#define VK_A_PLANES 65
#define VK_A_STATISTICS 22
#define VK_N_INPUTS 35
#define VK_N_HIDDEN 32
#define VK_N_ALL 96 /* hidden values of three networks */
#define VK_N_OUTPUTS 110
#define VK_N_COVARIANCE 10
#define VK_N_COLOUR 80
#define VK_N_LOOK 32
#define VK_NO_LOOK 0xfffffffeu /* in place of a photo: zeros */
#define VK_N_PART_DISTANCE 1
#define VK_N_PART_BANK 2
#define VK_W_OUTPUT 3456
#define VK_W_BIAS 6976
#define VK_W_DISTANCE 7086
#define VK_W_BANK_INPUT 7182
#define VK_W_BANK_OUTPUT 7342
#define VK_W_BANK_BIAS 7438
#define VK_W_LOOK 7441
#define VK_W_ALL 8465
#define VK_A_VALUES 68   /* that are learned: three scales, then VK_A_PLANES */
#define VK_A_PIECES 128  /* at most, of the weights' gradients */
#define VK_A_SEEN 0x8000 /* of an anchor's word of `exists`, beside a bit for each Gaussian */

/* Which anchors a view sees: 1 or 0 in `places`, and VK_A_SEEN or 0 in `exists`. Of the others, the
 * opacities in `to` become no number: their Gaussians do not exist. */
#define ARGS_anchors_see(P, U, F)                                                                  \
    P(Floats, params) P(Floats, view) P(Floats, to) P(Uints, exists) P(Floats, opacities)          \
    P(Uints, places) U(count) U(grid_x) U(grid_y)
/* The seen anchors in order; places: how many are before each. */
#define ARGS_anchors_list(P, U, F) P(Uints, exists) P(Uints, places) P(Uints, seen) U(count)
/* Gaussians of the anchors of a list, to parameters of SH degree 0; those that do not exist have no
 * number as opacity. seen_count: the length of `seen`; opacities: of each anchor, their sum; drawn:
 * their number, which begins as 0. */
#define ARGS_neural(P, U, F)                                                                       \
    P(Floats, params) P(Floats, anchors) P(Floats, weights) P(Floats, view) P(Floats, to)          \
    P(Uints, seen) P(Uints, seen_count) P(Uints, exists) P(Floats, opacities) P(Uints, drawn)      \
    U(count)
/* The gradient of those Gaussians, `made`, to the values of their anchors, in blocks of VK_A_VALUES
 * planes, and of the weights before VK_W_LOOK: each workgroup leaves a piece of their sums. */
#define ARGS_neural_backward(P, U, F)                                                              \
    P(Floats, params) P(Floats, anchors) P(Floats, weights) P(Floats, view) P(Floats, made)        \
    P(Floats, from) P(Uints, seen) P(Uints, seen_count) P(Uints, exists) P(Uints, drawn)           \
    P(Floats, gradient) P(Floats, sums) U(count) U(pieces) F(volume)
/* Sums of `width` values over `count` pieces, in a fixed order: a thread each. */
#define ARGS_piece_sums(P, U, F)                                                                   \
    P(Floats, from) P(Floats, to) U(count) U(width)
/* Appearances, of VK_N_LOOK values and their moments a photo. back 0: that of `photo`, zeros for
 * VK_NO_LOOK, or the mean of all if there is no such photo, to `look`, and what the colours' network
 * makes of it is added to the biases of `to`, a copy of the weights. 1: gradients of the weights
 * behind VK_W_LOOK, in `to`, and behind these of the appearance. */
#define ARGS_neural_look(P, U, F)                                                                  \
    P(Floats, looks) P(Floats, weights) P(Floats, look) P(Floats, to) U(photo) U(photos) U(back)
/* The view, in the statistics of growth. This and the steps of Adam change nothing once the device
 * has stopped. */
#define ARGS_anchors_count(P, U, F)                                                                \
    P(Uints, exists) P(Floats, opacities) P(Floats, grad_sum) P(Floats, grad_count)                \
    P(Floats, statistics) P(Uints, stop) U(count)
#define ARGS_anchors_learn(P, U, F)                                                                \
    P(Uints, exists) P(Floats, gradient) P(Floats, params) P(Floats, m) P(Floats, v)               \
    P(Floats, anchors) P(Floats, anchor_m) P(Floats, anchor_v) P(Uints, stop) U(count)             \
    F(rate_scale) F(rate_offset) F(rate_feature) F(root_scale) F(root_offset) F(root_feature)
/* networks: of each weight, the number of its rate. */
#define ARGS_networks_learn(P, U, F)                                                               \
    P(Uints, networks) P(Floats, gradient) P(Floats, weights) P(Floats, m) P(Floats, v)            \
    P(Floats, looks) P(Uints, stop) U(photo) U(photos) F(rate0) F(rate1) F(rate2) F(rate3)         \
    F(rate4) F(root)
/* clang-format on */

#endif
