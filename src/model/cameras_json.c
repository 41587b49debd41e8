/* SPDX-License-Identifier: Apache-2.0 */
#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "core/file.h"
#include "core/json_text.h"
#include "scene/cameras.h"
#include "splatguard/model.h"

/* Camera to world, focal lengths for the size of the photo's file. NULL without memory. */
static json_t *camera_json(const struct sg_view *v, int id)
{
    const struct sg_camera *c = &v->camera;
    json_t *rotation = json_array(), *position = json_array();
    bool whole = true;
    double centre[3];
    sg_camera_centre(c, centre);
    for (int i = 0; i < 3; i++) {
        whole &= !json_array_append_new(rotation,
                                        json_pack("[f,f,f]", c->R[i], c->R[3 + i], c->R[6 + i]));
        whole &= !json_array_append_new(position, json_real(centre[i]));
    }
    if (!whole) {
        json_decref(rotation);
        json_decref(position);
        return NULL;
    }
    const double sx = (double) v->file_width / c->width, sy = (double) v->file_height / c->height;
    json_t *camera =
        json_pack("{s:i,s:o,s:i,s:i,s:o,s:o,s:f,s:f}", "id", id, "img_name",
                  sg_text_to_json(v->name), "width", v->file_width, "height", v->file_height,
                  "position", position, "rotation", rotation, "fy", c->fy * sy, "fx", c->fx * sx);
    if (camera && (c->cx != c->width / 2.0 || c->cy != c->height / 2.0) &&
        (json_object_set_new(camera, "cx", json_real(c->cx * sx)) ||
         json_object_set_new(camera, "cy", json_real(c->cy * sy)))) {
        json_decref(camera);
        return NULL;
    }
    return camera;
}

int sg_cameras_write_json(sg_ctx *ctx, const struct sg_scene *scene, const char *path)
{
    sg_clear_error(ctx);
    json_t *list = json_array();
    for (size_t i = 0; i < scene->n_test + scene->n_train; i++)
        json_array_append_new(
            list,
            camera_json(i < scene->n_test ? &scene->test[i] : &scene->train[i - scene->n_test],
                        (int) i));
    char *text = json_dumps(list, JSON_COMPACT);
    int code = SG_ERR_BUDGET;
    if (text && json_array_size(list) == scene->n_test + scene->n_train) {
        code = sg_file_write(ctx, path, text, strlen(text));
    } else
        sg_fail(ctx, code, "%s: out of memory", path);
    free(text);
    json_decref(list);
    return code;
}
