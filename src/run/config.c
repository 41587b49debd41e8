/* SPDX-License-Identifier: Apache-2.0 */
#include "config.h"

#include <stdio.h>
#include <string.h>

#include "core/json_text.h"
#include "core/numbers.h"
#include "option/option.h"
#include "splatguard/run.h"

const struct sg_config_part sg_run_config[] = {
    {sg_run_options, 0, NULL},
    {sg_scene_options, offsetof(struct sg_run_params, scene), NULL},
    {sg_train_options, offsetof(struct sg_run_params, train), NULL},
    {0}};

/* An attack renders on black, regardless of the background of the scene's photos. */
const struct sg_config_part sg_attack_run_config[] = {
    {sg_attack_run_options, 0, NULL},
    {sg_scene_options, offsetof(struct sg_attack_run_params, scene),
     "white-background|smooth|test-halves"},
    {sg_attack_options, offsetof(struct sg_attack_run_params, attack), NULL},
    {0}};

static bool is_left_out(const struct sg_config_part *part, const struct sg_option *o)
{
    return o->transient || (part->without && sg_word_index(part->without, o->name) >= 0);
}

static bool is_real(const struct sg_option *o)
{
    return o->type == SG_OPTION_FLOAT || o->type == SG_OPTION_DOUBLE || o->type == SG_OPTION_TIME ||
           (o->type == SG_OPTION_LEVELS && !o->whole); /* whole ones may be "inf" */
}

static bool is_whole(const struct sg_option *o)
{
    return o->type == SG_OPTION_INT || o->type == SG_OPTION_U64 || o->type == SG_OPTION_BYTES;
}

void sg_config_round(const struct sg_config_part *parts, void *params)
{
    for (const struct sg_config_part *p = parts; p->rows; p++)
        for (const struct sg_option *o = p->rows(); o->name; o++)
            if (o->type == SG_OPTION_DOUBLE || o->type == SG_OPTION_TIME) {
                double *value = (double *) (void *) ((char *) params + p->at + o->offset);
                *value = sg_round_digits(*value);
            }
}

static json_t *value_json(const struct sg_option *o, const void *params)
{
    const void *value = (const char *) params + o->offset;
    char text[512], *end;
    if (o->type == SG_OPTION_FLAG)
        return json_boolean(*(const bool *) value);
    if (o->type == SG_OPTION_INT)
        return json_integer(*(const int *) value);
    if (is_whole(o))
        return json_integer((json_int_t) * (const uint64_t *) value);
    if (o->type == SG_OPTION_TEXT)
        return *(const char *const *) value ? sg_bytes_to_json(*(const char *const *) value)
                                            : json_null();
    sg_option_get(o, params, text, sizeof(text));
    const double number = sg_strtod(text, &end);
    return is_real(o) && end != text && !*end ? json_real(number) : json_string(text);
}

json_t *sg_config_to_json(const struct sg_config_part *parts, const void *params)
{
    json_t *object = json_object();
    for (const struct sg_config_part *p = parts; p->rows; p++)
        for (const struct sg_option *o = p->rows(); o->name; o++)
            if (!is_left_out(p, o))
                json_object_set_new(object, o->name, value_json(o, (const char *) params + p->at));
    return object;
}

int sg_config_check(sg_ctx *ctx, const struct sg_config_part *parts, const void *params)
{
    for (const struct sg_config_part *p = parts; p->rows; p++)
        for (const struct sg_option *o = p->rows(); o->name; o++) {
            const void *value = (const char *) params + p->at + o->offset;
            if (o->any && o->type == SG_OPTION_U64 && *(const uint64_t *) value > o->high)
                return sg_fail(ctx, SG_ERR_USAGE,
                               "%s: found %llu, expected at most %.0f, which a run's files can "
                               "carry",
                               o->name, (unsigned long long) *(const uint64_t *) value, o->high);
        }
    return SG_OK;
}

static int set_value(sg_ctx *ctx, const struct sg_option *o, void *params, const json_t *v,
                     const char *path)
{
    const bool number = (is_whole(o) || is_real(o)) && !(o->words && json_is_string(v));
    char shown[SG_JSON_SHOWN], text[64], expected[256];
    if (json_is_null(v))
        return SG_OK;
    if (o->type == SG_OPTION_FLAG ? !json_is_boolean(v)
        : number                  ? !json_is_number(v)
                                  : !json_is_string(v))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: option \"%s\": found %s, expected %s", path, o->name,
                       sg_json_show(v, shown),
                       o->type == SG_OPTION_FLAG ? "true or false"
                       : number                  ? "a number"
                                                 : "a text");
    const char *value = json_is_boolean(v) ? json_is_true(v) ? "true" : "false"
                        : number           ? text
                                           : json_string_value(v);
    const locale_t before = uselocale(sg_c_locale());
    if (json_is_integer(v))
        snprintf(text, sizeof(text), "%lld", (long long) json_integer_value(v));
    else if (json_is_real(v))
        snprintf(text, sizeof(text), "%.17g", json_real_value(v));
    uselocale(before);
    if (!sg_option_set(o, params, value, expected, sizeof(expected)))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: option \"%s\": found \"%s\", expected %s", path,
                       o->name, value, expected);
    return SG_OK;
}

/* False where no table has the option. */
static bool find(const struct sg_config_part *parts, const char *key, const struct sg_option **o,
                 size_t *at)
{
    for (const struct sg_config_part *p = parts; p->rows; p++) {
        *o = sg_option_find(p->rows(), key);
        *at = p->at;
        if (*o && !is_left_out(p, *o))
            return true;
    }
    return false;
}

int sg_config_from_json(sg_ctx *ctx, const struct sg_config_part *parts, void *params,
                        const json_t *object, bool strict, const char *path)
{
    const char *key;
    json_t *v;
    int code = SG_OK;
    if (!json_is_object(object))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no \"options\", expected an object", path);
    json_object_foreach((json_t *) object, key, v)
    {
        const struct sg_option *o;
        size_t at;
        if (code)
            break;
        if (find(parts, key, &o, &at))
            code = set_value(ctx, o, (char *) params + at, v, path);
        else if (strict)
            code = sg_fail(ctx, SG_ERR_INPUT, "%s: found an unknown option \"%s\"", path, key);
    }
    return code;
}
