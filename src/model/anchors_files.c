/* SPDX-License-Identifier: Apache-2.0 */
/* Files of a model of anchors: a PLY file with the properties of the released code, and beside it
 * the networks' weights as safetensors (a length, a JSON header, raw data). */
#include <dirent.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include <jansson.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "anchors.h"
#include "core/file.h"
#include "core/json_text.h"
#include "core/numbers.h"
#include "ply.h"

/* ---- anchors ---- */

/* Where a value of an anchor lies: in sg_model.params, or in the column. */
struct place {
    bool column;
    int plane; /* -1: it is a normal, always 0 */
    char name[24];
};
#define PROPERTIES 79

/* In the order of the file. */
static void list_properties(struct place out[PROPERTIES])
{
    int n = 0;
#define ADD(column_, plane_, ...)                                                                  \
    do {                                                                                           \
        out[n] = (struct place){.column = column_, .plane = plane_};                               \
        snprintf(out[n++].name, sizeof(out->name), __VA_ARGS__);                                   \
    } while (0)
    for (int k = 0; k < 3; k++)
        ADD(false, SG_P_XYZ + k, "%c", 'x' + k);
    for (int k = 0; k < 3; k++)
        ADD(false, -1, "n%c", 'x' + k);
    for (int k = 0; k < 3 * SG_ANCHOR_GAUSSIANS; k++) /* by axis */
        ADD(true, SG_A_OFFSET + 3 * (k % SG_ANCHOR_GAUSSIANS) + k / SG_ANCHOR_GAUSSIANS,
            "f_offset_%d", k);
    for (int k = 0; k < SG_ANCHOR_FEATURES; k++)
        ADD(true, SG_A_FEATURE + k, "f_anchor_feat_%d", k);
    ADD(false, SG_P_OPACITY, "opacity");
    for (int k = 0; k < 6; k++)
        ADD(k >= 3, k < 3 ? SG_P_SCALE + k : SG_A_SIZE + k - 3, "scale_%d", k);
    for (int k = 0; k < 4; k++)
        ADD(false, SG_P_ROT + k, "rot_%d", k);
#undef ADD
}

static float *value_at(const struct sg_model *m, const struct place *p, size_t i)
{
    return p->column ? &m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, p->plane)]
                     : sg_model_at(m, i, p->plane);
}

/* To be committed, or abandoned after an error. */
static int write_anchors(sg_ctx *ctx, const struct sg_model *m, const char *path,
                         const char *of_networks, struct sg_file_writer *w)
{
    struct place place[PROPERTIES];
    const int code = sg_file_create(ctx, w, path);
    if (code)
        return code;
    list_properties(place);
    fprintf(w->stream,
            "ply\nformat binary_little_endian 1.0\ncomment splatguard %s, anchors of Scaffold-GS: "
            "their networks are in " SG_NETWORKS_FILE "\n" PLY_NETWORKS "%s\nelement vertex %zu\n",
            sg_version(), of_networks, m->count);
    for (int k = 0; k < PROPERTIES; k++)
        fprintf(w->stream, "property float %s\n", place[k].name);
    fprintf(w->stream, "end_header\n");
    for (size_t i = 0; i < m->count; i++) {
        float row[PROPERTIES];
        for (int k = 0; k < PROPERTIES; k++)
            row[k] = place[k].plane < 0 ? 0 : *value_at(m, &place[k], i);
        fwrite(row, sizeof(float), PROPERTIES, w->stream);
    }
    return sg_file_sync(ctx, w);
}

/* ---- networks ---- */

static const char *const networks[] = {"opacity", "covariance", "colour", "feature_bank"};

/* As the metadata names them. */
static const struct {
    enum sg_network_part part;
    const char *name;
} part_names[] = {{SG_PART_DISTANCE, "distance"},
                  {SG_PART_BANK, "feature_bank"},
                  {SG_PART_APPEARANCE, "appearance"}};
#define PARTS (sizeof(part_names) / sizeof(part_names[0]))

/* A matrix or biases of a network as PyTorch has them: linear layer 0 or 2 of it; or the
 * appearances, a row for each photo. */
struct tensor {
    char name[40];
    int rows, columns; /* columns 0: biases */
    int network, layer;
};
#define MOST_TENSORS (4 * SG_NETWORK_RATES)
#define APPEARANCES "appearance.weight"

static int outputs_of(int network)
{
    return network == SG_N_BANK ? SG_BANK_OUTPUTS
                                : sg_network_row(network + 1) - sg_network_row(network);
}

/* Returns their number. */
static int list_tensors(unsigned parts, size_t photos, struct tensor out[MOST_TENSORS])
{
    const int count = parts & SG_PART_BANK ? SG_N_BANK + 1 : SG_NETWORKS;
    int k = 0;
    for (int n = 0; n < count; n++)
        for (int layer = 0; layer <= 2; layer += 2)
            for (int bias = 0; bias < 2; bias++, k++) {
                const int columns =
                    layer ? SG_NETWORK_HIDDEN : sg_network_inputs((enum sg_network) n, parts);
                out[k] = (struct tensor){.rows = layer ? outputs_of(n) : SG_NETWORK_HIDDEN,
                                         .columns = bias ? 0 : columns,
                                         .network = n,
                                         .layer = layer};
                snprintf(out[k].name, sizeof(out[k].name), "%s.%d.%s", networks[n], layer,
                         bias ? "bias" : "weight");
            }
    if (parts & SG_PART_APPEARANCE)
        out[k++] = (struct tensor){.name = APPEARANCES,
                                   .rows = (int) photos,
                                   .columns = SG_APPEARANCE,
                                   .network = SG_N_APPEARANCE};
    return k;
}

static size_t values_of(const struct tensor *t)
{
    return (size_t) t->rows * (size_t) (t->columns ? t->columns : 1);
}

static float *weight_at(struct sg_networks *n, const struct tensor *t, size_t k)
{
    struct sg_weights *w = &n->value;
    const size_t columns = (size_t) (t->columns ? t->columns : 1), row = k / columns,
                 column = k % columns;
    if (t->network == SG_N_APPEARANCE)
        return &n->appearance[row].value[column];
    if (t->network == SG_N_BANK && !t->layer)
        return &w->bank_input[t->columns ? column : SG_BANK_INPUTS][row];
    if (t->network == SG_N_BANK)
        return t->columns ? &w->bank_output[row][column] : &w->bank_bias[row];
    const size_t hidden = (size_t) (t->network * SG_NETWORK_HIDDEN) + row;
    if (!t->layer) {
        const size_t distance = n->parts & SG_PART_DISTANCE ? 1 : 0,
                     own = SG_NETWORK_INPUTS + distance;
        return t->columns && column >= own ? &w->appearance[column - own][row]
               : t->columns && column == SG_NETWORK_INPUTS
                   ? &w->distance[hidden]
                   : &w->input[t->columns ? column : SG_NETWORK_INPUTS][hidden];
    }
    const size_t output = (size_t) sg_network_row(t->network) + row;
    return t->columns ? &w->output[output][column] : &w->bias[output];
}

static json_t *shape_of(const struct tensor *t)
{
    return t->columns ? json_pack("[i,i]", t->rows, t->columns) : json_pack("[i]", t->rows);
}

/* The names of the parts, with a space behind each but the last. */
static void name_parts(unsigned parts, char *out, size_t size)
{
    *out = 0;
    for (size_t k = 0; k < PARTS; k++)
        if (parts & part_names[k].part) {
            const size_t at = strlen(out);
            snprintf(out + at, size - at, "%s%s", at ? " " : "", part_names[k].name);
        }
}

/* Their bits; false: a name is not known. */
static bool read_parts(const json_t *root, unsigned *out)
{
    const char *at =
        json_string_value(json_object_get(json_object_get(root, "__metadata__"), "parts"));
    *out = 0;
    while (at && *at) {
        const size_t length = strcspn(at, " ");
        size_t k = 0;
        while (k < PARTS && (strlen(part_names[k].name) != length ||
                             memcmp(part_names[k].name, at, length) != 0))
            k++;
        if (k == PARTS)
            return false;
        *out |= part_names[k].part;
        at += length + (at[length] == ' ');
    }
    return true;
}

static char *header_text(const struct sg_networks *n, const struct tensor *tensors, int count)
{
    char parts[64];
    char voxel[32];
    const locale_t before = uselocale(sg_c_locale());
    snprintf(voxel, sizeof(voxel), "%.9g", (double) n->voxel);
    uselocale(before);
    json_t *root = json_pack("{s:{s:s,s:s}}", "__metadata__", "format", "splatguard scaffold 1",
                             "voxel", voxel);
    if (n->parts) {
        name_parts(n->parts, parts, sizeof(parts));
        json_object_set_new(json_object_get(root, "__metadata__"), "parts", json_string(parts));
    }
    size_t at = 0;
    for (int k = 0; k < count; k++) {
        const size_t end = at + values_of(&tensors[k]) * sizeof(float);
        json_object_set_new(root, tensors[k].name,
                            json_pack("{s:s,s:o,s:[I,I]}", "dtype", "F32", "shape",
                                      shape_of(&tensors[k]), "data_offsets", (json_int_t) at,
                                      (json_int_t) end));
        at = end;
    }
    char *text = json_dumps(root, JSON_COMPACT);
    json_decref(root);
    return text;
}

/* By which anchors know their networks: of all bytes of the file. */
static void hash_of(const char *bytes, size_t size, char out[PLY_HASH])
{
    snprintf(out, PLY_HASH, "%016" PRIx64, (uint64_t) XXH3_64bits(bytes, size));
}

/* As write_anchors. */
static int write_networks(sg_ctx *ctx, struct sg_networks *n, const char *path,
                          struct sg_file_writer *w)
{
    struct tensor tensors[MOST_TENSORS];
    const int count = list_tensors(n->parts, n->photos, tensors);
    char *text = header_text(n, tensors, count);
    int code = text ? sg_file_create(ctx, w, path) : sg_fail(ctx, SG_ERR_BUDGET, "out of memory");
    if (!code) {
        const uint64_t size = (strlen(text) + 7) / 8 * 8; /* padded with spaces */
        fwrite(&size, sizeof(size), 1, w->stream);
        fprintf(w->stream, "%-*s", (int) size, text);
        for (int k = 0; k < count; k++)
            for (size_t i = 0; i < values_of(&tensors[k]); i++)
                fwrite(weight_at(n, &tensors[k], i), sizeof(float), 1, w->stream);
        code = sg_file_sync(ctx, w);
    }
    free(text);
    return code;
}

#define HEADER_MAX (64 << 10)
#define FILE_MAX (16 << 20)
#define PHOTOS_MAX (64 << 10)

/* Networks for what a header says: parts, and the appearances of the photos that their tensor has
 * rows for. */
static int create_networks(sg_ctx *ctx, const char *path, const json_t *root,
                           struct sg_networks **out)
{
    unsigned parts;
    if (!read_parts(root, &parts))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found parts other than distance, feature_bank and appearance "
                       "in __metadata__",
                       path);
    const json_int_t photos = json_integer_value(
        json_array_get(json_object_get(json_object_get(root, APPEARANCES), "shape"), 0));
    if (parts & SG_PART_APPEARANCE && !(photos > 0 && photos <= PHOTOS_MAX))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found " APPEARANCES " of %" JSON_INTEGER_FORMAT
                       " photos, expected 1 to %d",
                       path, photos, PHOTOS_MAX);
    *out = sg_networks_create(ctx, parts & SG_PART_APPEARANCE ? (size_t) photos : 0);
    if (!*out)
        return SG_ERR_BUDGET;
    (*out)->parts = parts;
    return SG_OK;
}

/* The number of a metadata entry, which safetensors keeps as text. */
static bool read_voxel(const json_t *root, float *out)
{
    const char *text =
        json_string_value(json_object_get(json_object_get(root, "__metadata__"), "voxel"));
    char *end;
    *out = text ? sg_strtof(text, &end) : 0;
    return text && end != text && !*end && *out > 0 && isfinite(*out);
}

/* Where the values of a tensor begin in the data. */
static int find_tensor(sg_ctx *ctx, const char *path, const json_t *root, const struct tensor *t,
                       size_t data, size_t *at)
{
    const json_t *entry = json_object_get(root, t->name);
    json_t *shape = shape_of(t);
    const json_t *offsets = json_object_get(entry, "data_offsets");
    const char *type = json_string_value(json_object_get(entry, "dtype"));
    const json_int_t first = json_integer_value(json_array_get(offsets, 0)),
                     end = json_integer_value(json_array_get(offsets, 1));
    const bool sound = type && !strcmp(type, "F32") &&
                       json_equal(json_object_get(entry, "shape"), shape) && first >= 0 &&
                       end >= first && (uint64_t) end <= data &&
                       (uint64_t) (end - first) == values_of(t) * sizeof(float);
    json_decref(shape);
    *at = (size_t) first;
    return sound ? SG_OK
                 : sg_fail(ctx, SG_ERR_INPUT,
                           "%s: header: found no tensor %s of %d x %d float32 values in %zu bytes "
                           "of data",
                           path, t->name, t->rows, t->columns ? t->columns : 1, data);
}

static int parse_networks(sg_ctx *ctx, const char *path, const char *bytes, size_t size,
                          struct sg_networks **out)
{
    uint64_t length = 0;
    float voxel;
    json_error_t error;
    struct tensor tensors[MOST_TENSORS];
    if (size >= sizeof(length))
        memcpy(&length, bytes, sizeof(length));
    if (size < sizeof(length) || length > HEADER_MAX || length > size - sizeof(length))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte 0: found a header of %" PRIu64 " bytes in a file of %zu, expected "
                       "one of at most %d: safetensors",
                       path, length, size, HEADER_MAX);
    const char *header = bytes + sizeof(length), *data = header + length;
    const size_t left = size - sizeof(length) - (size_t) length;
    void *room;
    int code = sg_json_reserve(ctx, header, (size_t) length, &room);
    json_t *root =
        code ? NULL : json_loadb(header, (size_t) length, JSON_REJECT_DUPLICATES, &error);
    if (!code && !json_is_object(root))
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: header: found no JSON object: %s", path, error.text);
    if (!code && !read_voxel(root, &voxel))
        code =
            sg_fail(ctx, SG_ERR_INPUT, "%s: header: found no voxel above 0 in __metadata__", path);
    if (!code && !(code = create_networks(ctx, path, root, out)))
        (*out)->voxel = voxel;
    const int count = code ? 0 : list_tensors((*out)->parts, (*out)->photos, tensors);
    for (int k = 0; k < count && !code; k++) {
        size_t at;
        code = find_tensor(ctx, path, root, &tensors[k], left, &at);
        for (size_t i = 0; i < values_of(&tensors[k]) && !code; i++) {
            float v;
            memcpy(&v, data + at + i * sizeof(v), sizeof(v));
            if (!isfinite(v))
                code = sg_fail(ctx, SG_ERR_INPUT,
                               "%s: %s: found value %zu of %g, expected finite numbers", path,
                               tensors[k].name, i, (double) v);
            *weight_at(*out, &tensors[k], i) = v;
        }
    }
    json_decref(root);
    sg_free(room);
    return code;
}

/* The file beside a PLY file. */
static char *networks_path(sg_ctx *ctx, const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? sg_strf(ctx, "%.*s/" SG_NETWORKS_FILE, (int) (slash - path), path)
                 : sg_strdup(ctx, SG_NETWORKS_FILE);
}

/* ---- both ---- */

/* SG_ERR_INPUT for the anchors of another model: the networks are theirs. A file that cannot be
 * read as such has none. */
static int refuse_owner(sg_ctx *ctx, const char *other, const char *beside)
{
    bool anchors;
    const int code = sg_anchors_recognise(ctx, other, &anchors);
    if (code == SG_ERR_BUDGET)
        return code;
    sg_clear_error(ctx);
    return anchors ? sg_fail(ctx, SG_ERR_INPUT,
                             "%s: cannot write: found the networks of the anchors in %s, expected "
                             "one model of anchors in a folder",
                             beside, other)
                   : SG_OK;
}

/* The same for all files beside a path that are not that one by another name. */
static int refuse_owners(sg_ctx *ctx, const char *path, const char *beside)
{
    const int folder_length = (int) (sg_base_name(path) - path);
    struct stat st, own = {0};
    const bool replaces = !stat(path, &own);
    char *folder = sg_strf(ctx, "%.*s.", folder_length, path);
    DIR *d = folder ? opendir(folder) : NULL;
    int code = folder ? SG_OK : SG_ERR_BUDGET;
    for (struct dirent *e; d && !code && (e = readdir(d));) {
        char *other = sg_strf(ctx, "%.*s%s", folder_length, path, e->d_name);
        const bool same = replaces && other && !stat(other, &st) && st.st_dev == own.st_dev &&
                          st.st_ino == own.st_ino;
        if (!same)
            code = other ? refuse_owner(ctx, other, beside) : SG_ERR_BUDGET;
        sg_free(other);
    }
    if (d)
        closedir(d);
    sg_free(folder);
    return code;
}

static int hash_file(sg_ctx *ctx, const char *path, char out[PLY_HASH])
{
    char *bytes;
    size_t size;
    const int code = sg_file_read(ctx, path, FILE_MAX, &bytes, &size);
    if (!code)
        hash_of(bytes, size, out);
    sg_free(bytes);
    return code;
}

/* Networks that would be replaced by others are of no other anchors. */
static int check_networks(sg_ctx *ctx, const char *path, const char *beside, const char *hash)
{
    char found[PLY_HASH];
    if (!sg_file_exists(beside))
        return SG_OK;
    const int code = hash_file(ctx, beside, found);
    if (code == SG_ERR_BUDGET || (!code && !strcmp(found, hash)))
        return code;
    sg_clear_error(ctx);
    return refuse_owners(ctx, path, beside);
}

int sg_anchors_write(sg_ctx *ctx, const struct sg_model *m, const char *path)
{
    char hash[PLY_HASH];
    struct sg_file_writer of_networks = {0}, of_anchors = {0};
    char *beside = networks_path(ctx, path);
    int code = beside ? SG_OK : SG_ERR_BUDGET;
    if (!code)
        code = write_networks(ctx, m->columns->networks, beside, &of_networks);
    if (!code)
        code = hash_file(ctx, of_networks.temporary, hash);
    if (!code)
        code = check_networks(ctx, path, beside, hash);
    if (!code)
        code = write_anchors(ctx, m, path, hash, &of_anchors);
    if (!code) /* with the bytes of both on the disk */
        code = sg_file_commit(ctx, &of_networks);
    if (!code)
        code = sg_file_commit(ctx, &of_anchors);
    sg_file_abandon(&of_networks);
    sg_file_abandon(&of_anchors);
    sg_free(beside);
    return code;
}

static int read_rows(sg_ctx *ctx, struct ply *p, const struct place *place, const int *index,
                     struct sg_model *m)
{
    float row[PLY_MAX_PROPERTIES];
    for (size_t i = 0; i < m->count; i++) {
        const int code = sg_ply_row(ctx, p, i, row);
        if (code)
            return code;
        for (int k = 0; k < PROPERTIES; k++) {
            if (place[k].plane < 0)
                continue;
            if (!isfinite(row[index[k]]))
                return sg_fail(ctx, SG_ERR_INPUT,
                               "%s: anchor %zu: found %s %g, expected a finite number", p->in->path,
                               i, place[k].name, (double) row[index[k]]);
            *value_at(m, &place[k], i) = row[index[k]];
        }
    }
    return sg_ply_finish(ctx, p);
}

/* of_networks: their hash, or "". */
static int read_anchors(sg_ctx *ctx, struct sg_source *in, uint64_t max_anchors,
                        char of_networks[PLY_HASH], struct sg_model **out)
{
    struct ply p;
    struct place place[PROPERTIES];
    int index[PROPERTIES];
    int code = sg_ply_open(ctx, &p, in, max_anchors);
    memcpy(of_networks, p.networks, PLY_HASH);
    list_properties(place);
    for (int k = 0; k < PROPERTIES && !code; k++)
        if ((index[k] = sg_ply_find(&p, place[k].name)) < 0 && place[k].plane >= 0)
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: header: found no property %s, expected anchors of Scaffold-GS",
                           in->path, place[k].name);
    if (!code && !p.rows)
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: header: found 0 anchors, expected at least one",
                       in->path);
    if (!code)
        code = sg_model_refused(ctx, sg_model_create(ctx, (size_t) p.rows, 0, out), in->path,
                                p.rows, PROPERTIES * sizeof(float));
    if (!code)
        code = sg_model_refused(ctx, sg_anchors_add(ctx, *out, 0), in->path, p.rows,
                                PROPERTIES * sizeof(float));
    return code ? code : read_rows(ctx, &p, place, index, *out);
}

int sg_anchors_read(sg_ctx *ctx, const char *path, uint64_t max_anchors, struct sg_model **out)
{
    struct sg_source in;
    char *beside = networks_path(ctx, path), *bytes = NULL;
    char expected[PLY_HASH], found[PLY_HASH];
    struct sg_networks *networks_read = NULL;
    size_t size = 0;
    *out = NULL;
    int code = beside ? sg_source_open(ctx, &in, path, PLY_MAX_BYTES) : SG_ERR_BUDGET;
    if (!code)
        code = read_anchors(ctx, &in, max_anchors, expected, out);
    if (beside)
        sg_source_close(&in);
    if (!code && !sg_file_exists(beside))
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found anchors of Scaffold-GS alone, expected their networks beside "
                       "them, in %s",
                       path, beside);
    if (!code)
        code = sg_file_read(ctx, beside, FILE_MAX, &bytes, &size);
    if (!code)
        code = parse_networks(ctx, beside, bytes, size, &networks_read);
    if (!code && *expected) {
        hash_of(bytes, size, found);
        if (strcmp(found, expected) != 0)
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found networks with the hash %s, expected those that %s was saved "
                           "with, %s",
                           beside, found, path, expected);
    }
    if (!code) {
        sg_free((*out)->columns->networks);
        (*out)->columns->networks = networks_read;
        networks_read = NULL;
    }
    sg_free(networks_read);
    if (code)
        sg_model_destroy(out);
    sg_free(bytes);
    sg_free(beside);
    return code;
}

int sg_anchors_recognise(sg_ctx *ctx, const char *path, bool *found)
{
    struct sg_source in;
    struct ply p = {.in = &in};
    *found = false;
    int code = sg_source_open(ctx, &in, path, PLY_MAX_BYTES);
    if (!code && sg_ply_is_marked(&in) && !(code = sg_ply_parse_header(ctx, &p)))
        for (int i = 0; i < p.total; i++)
            *found |= !strcmp(p.all[i].name, "f_anchor_feat_0");
    sg_source_close(&in);
    return code;
}
