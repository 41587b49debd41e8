/* SPDX-License-Identifier: Apache-2.0 */
/* Blender's transforms (Mildenhall et al. 2020) and COLMAP's binary model (Schoenberger and Frahm
 * 2016). */
#include "files.h"

#include "core/file.h"
#include "core/numbers.h"

int sg_synth_write_transforms(sg_ctx *ctx, const char *folder, const char *split,
                              const struct synth_camera *cameras, int count, double angle_x)
{
    struct sg_file_writer w = {0};
    char *path = sg_strf(ctx, "%s/transforms_%s.json", folder, split);
    int code = path ? sg_file_create(ctx, &w, path) : SG_ERR_BUDGET;
    if (code)
        goto done;
    const locale_t before = uselocale(sg_c_locale());
    fprintf(w.stream, "{\n    \"camera_angle_x\": %.17g,\n    \"frames\": [", angle_x);
    for (int i = 0; i < count; i++) {
        const struct synth_camera *c = &cameras[i];
        /* camera-to-world, OpenGL axes: x right, y up, z back */
        const double rows[3][4] = {{c->right.x, c->up.x, -c->forward.x, c->centre.x},
                                   {c->right.y, c->up.y, -c->forward.y, c->centre.y},
                                   {c->right.z, c->up.z, -c->forward.z, c->centre.z}};
        fprintf(w.stream,
                "%s\n        {\n            \"file_path\": \"./%s/r_%d\",\n            "
                "\"transform_matrix\": [",
                i ? "," : "", split, i);
        for (int r = 0; r < 3; r++)
            fprintf(w.stream, "\n                [%.17g, %.17g, %.17g, %.17g],", rows[r][0],
                    rows[r][1], rows[r][2], rows[r][3]);
        fprintf(w.stream, "\n                [0, 0, 0, 1]\n            ]\n        }");
    }
    fprintf(w.stream, "\n    ]\n}\n");
    uselocale(before);
    code = sg_file_commit(ctx, &w);
done:
    sg_file_abandon(&w);
    sg_free(path);
    return code;
}

static void put_cameras(FILE *f, const struct synth_colmap *m)
{
    const struct synth_camera *c = m->cameras;
    sg_put_int(f, 1, 8);
    sg_put_int(f, 1, 4); /* id */
    sg_put_int(f, 1, 4); /* PINHOLE */
    sg_put_int(f, (uint64_t) c->width, 8);
    sg_put_int(f, (uint64_t) c->height, 8);
    sg_put_real(f, c->focal);
    sg_put_real(f, c->focal);
    sg_put_real(f, 0.5 * c->width);
    sg_put_real(f, 0.5 * c->height);
}

/* Of the rotation with these rows; Shepperd's choice of the largest component (1978). */
static void quaternion(struct vec x, struct vec y, struct vec z, double q[4])
{
    const double m[3][3] = {{x.x, x.y, x.z}, {y.x, y.y, y.z}, {z.x, z.y, z.z}};
    const double trace = x.x + y.y + z.z;
    int i = y.y > x.x ? 1 : 0;
    i = z.z > m[i][i] ? 2 : i;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    if (trace > m[i][i]) {
        const double s = 0.5 / sqrt(1 + trace);
        q[0] = 0.25 / s;
        q[1] = (m[2][1] - m[1][2]) * s;
        q[2] = (m[0][2] - m[2][0]) * s;
        q[3] = (m[1][0] - m[0][1]) * s;
    } else {
        const double s = 0.5 / sqrt(1 + m[i][i] - m[j][j] - m[k][k]);
        q[0] = (m[k][j] - m[j][k]) * s;
        q[1 + i] = 0.25 / s;
        q[1 + j] = (m[j][i] + m[i][j]) * s;
        q[1 + k] = (m[k][i] + m[i][k]) * s;
    }
}

static void put_images(FILE *f, const struct synth_colmap *m)
{
    sg_put_int(f, (uint64_t) m->count, 8);
    for (int k = 0; k < m->count; k++) {
        const int view = m->order[k];
        const struct synth_camera *c = &m->cameras[view];
        const struct vec down = scale(c->up, -1);
        double q[4];
        quaternion(c->right, down, c->forward, q);
        sg_put_int(f, (uint64_t) k + 1, 4);
        for (int i = 0; i < 4; i++)
            sg_put_real(f, q[i]);
        sg_put_real(f, -dot(c->right, c->centre));
        sg_put_real(f, -dot(down, c->centre));
        sg_put_real(f, -dot(c->forward, c->centre));
        sg_put_int(f, 1, 4);
        fprintf(f, SYNTH_COLMAP_NAME, k);
        putc(0, f);
        const int first = view < m->views ? view : m->n_points;
        sg_put_int(f, (uint64_t) ((m->n_points - first + m->views - 1) / m->views), 8);
        for (int i = first; i < m->n_points; i += m->views) {
            sg_put_real(f, m->points[i].x);
            sg_put_real(f, m->points[i].y);
            sg_put_int(f, (uint64_t) i + 1, 8);
        }
    }
}

static void put_points(FILE *f, const struct synth_colmap *m)
{
    sg_put_int(f, (uint64_t) m->n_points, 8);
    for (int i = 0; i < m->n_points; i++) {
        const struct synth_point *p = &m->points[i];
        sg_put_int(f, (uint64_t) i + 1, 8);
        sg_put_real(f, p->p.x);
        sg_put_real(f, p->p.y);
        sg_put_real(f, p->p.z);
        fwrite(p->rgb, 1, 3, f);
        sg_put_real(f, 0);
        sg_put_int(f, 1, 8); /* seen once: by this image, as its observation number i / views */
        sg_put_int(f, (uint64_t) m->view_of[i % m->views] + 1, 4);
        sg_put_int(f, (uint64_t) (i / m->views), 4);
    }
}

int sg_synth_write_colmap(sg_ctx *ctx, const char *folder, const struct synth_colmap *model)
{
    static const struct {
        const char *name;
        void (*put)(FILE *, const struct synth_colmap *);
    } files[] = {{"points3D", put_points}, {"images", put_images}, {"cameras", put_cameras}};
    int code = SG_OK;
    for (size_t i = 0; i < sizeof(files) / sizeof(*files) && !code; i++) {
        struct sg_file_writer w = {0};
        char *path = sg_strf(ctx, "%s/%s.bin", folder, files[i].name);
        code = path ? sg_file_create(ctx, &w, path) : SG_ERR_BUDGET;
        if (!code) {
            files[i].put(w.stream, model);
            code = sg_file_commit(ctx, &w);
        }
        sg_file_abandon(&w);
        sg_free(path);
    }
    return code;
}
