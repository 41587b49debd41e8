/* SPDX-License-Identifier: Apache-2.0 */
#include <sys/resource.h>

#include "core/json_text.h"
#include "splatguard/engine.h"
#include "train.h"
#include "train/trainer.h"

static json_t *machine(void)
{
    char name[256];
    sg_machine_name(name, sizeof(name));
    return sg_text_to_json(name);
}

/* The larger of a peak of this process and that of the processes before it. */
static json_t *peak_json(uint64_t here, const json_t *earlier, const char *key)
{
    const json_int_t before = json_integer_value(json_object_get(earlier, key));
    return json_integer(before > (json_int_t) here ? before : (json_int_t) here);
}

/* Puts the peak of all tags under one key, and that of each under the other. */
static void put_peaks(json_t *s, const sg_run *r, const char *key, const char *by_tag,
                      uint64_t (*peak)(const sg_ctx *, enum sg_mem_tag))
{
    const json_t *earlier = json_object_get(r->earlier, by_tag);
    json_t *tags = json_object();
    for (int tag = 0; tag < SG_MEM_TAGS; tag++) {
        const char *name = sg_mem_tag_name((enum sg_mem_tag) tag);
        json_object_set_new(tags, name,
                            peak_json(peak(r->ctx, (enum sg_mem_tag) tag), earlier, name));
    }
    json_object_set_new(s, key, peak_json(peak(r->ctx, SG_MEM_TAGS), r->earlier, key));
    json_object_set_new(s, by_tag, tags);
}

static json_t *stages(const sg_trainer *trainer)
{
    struct sg_train_times t;
    sg_trainer_times(trainer, &t);
    const struct {
        const char *name;
        double seconds;
    } all[] = {{"project", t.project}, {"bin", t.bin},       {"raster", t.raster},
               {"loss", t.loss},       {"update", t.update}, {"raster_backward", t.raster_backward},
               {"densify", t.densify}, {"count", t.count}};
    json_t *object = json_object();
    for (size_t i = 0; i < sizeof(all) / sizeof(all[0]); i++)
        json_object_set_new(object, all[i].name, sg_number_json(all[i].seconds));
    return object;
}

/* How many photos have a tolerance, and what it is on average, in grey levels; and how many are
 * smoothed instead. */
static json_t *tolerance(const sg_run *r)
{
    size_t photos = 0, smoothed = 0;
    double sum = 0;
    for (size_t i = 0; i < r->scene->n_train; i++) {
        const float levels = sg_trainer_tolerance(r->trainer, i);
        photos += levels > 0;
        smoothed += sg_trainer_smooths(r->trainer, i);
        sum += (double) levels;
    }
    return json_pack("{s:I,s:o,s:I}", "photos", (json_int_t) photos, "levels",
                     sg_number_json(photos ? sum / (double) photos : 0), "smoothed",
                     (json_int_t) smoothed);
}

/* The limits of the run and those that it met. */
static json_t *budget(const sg_run *r, const struct sg_train_limits *l)
{
    json_t *binding = json_array();
    const bool out_of_memory = r->ended_by == SG_ERR_BUDGET;
    if (l->gaussians_bound || out_of_memory)
        json_array_append_new(binding,
                              json_string(l->by_memory || out_of_memory ? "memory" : "gaussians"));
    if (l->time_bound)
        json_array_append_new(binding, json_string("time"));
    return json_pack("{s:I,s:I,s:I,s:o,s:o}", "max_gaussians", (json_int_t) l->max_gaussians,
                     "max_memory", (json_int_t) r->params.max_memory, "max_vram",
                     (json_int_t) r->params.max_vram, "max_time",
                     sg_number_json(r->train.max_seconds), "binding", binding);
}

/* Quality is comparable where views have as many pixels. */
static uint64_t test_pixels(const struct sg_scene *scene)
{
    uint64_t pixels = 0;
    for (size_t i = 0; i < scene->n_test; i++)
        pixels += (uint64_t) scene->test[i].camera.width * (uint64_t) scene->test[i].camera.height;
    return pixels;
}

int sg_run_write_summary(sg_run *r)
{
    const struct run_totals *t = &r->totals;
    const int done = sg_run_done(r);
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    json_t *s = json_object();
#define PUT(key, value) json_object_set_new(s, key, value)
#define COUNT(key, value) PUT(key, json_integer((json_int_t) (value)))
    PUT("version", json_string(sg_version()));
    PUT("scene", sg_text_to_json(r->params.source));
    struct sg_train_limits limits;
    sg_trainer_limits(r->trainer, &limits);
    COUNT("iterations", done);
    COUNT("steps", limits.steps);
    PUT("interrupted", json_boolean(done < r->train.iterations));
    COUNT("max_gaussians", t->max_gaussians);
    COUNT("final_gaussians", sg_trainer_gaussians(r->trainer));
    COUNT("max_instances", t->max_instances);
    if (r->train.defense.on)
        PUT("defense", json_pack("{s:I,s:I,s:o}", "filter_events", (json_int_t) t->filter_events,
                                 "filter_removed", (json_int_t) t->filter_removed, "seconds",
                                 sg_run_defense_seconds(r)));
    if (r->train.tolerance > 0 || r->train.tolerances)
        PUT("tolerance", tolerance(r));
    if (r->audit)
        PUT("audit",
            json_pack("{s:s,s:o}", "verdict", r->audit, "score", sg_number_json(r->audit_score)));
    PUT("budget", budget(r, &limits));
    PUT("train_seconds", sg_number_json(t->seconds));
    PUT("cpu_seconds", sg_number_json(t->cpu_seconds));
    PUT("iterations_per_second",
        sg_number_json(t->seconds > 0 ? (double) limits.steps / t->seconds : 0));
    PUT("peak_rss_bytes",
        peak_json((uint64_t) usage.ru_maxrss * 1024, r->earlier, "peak_rss_bytes"));
    put_peaks(s, r, "peak_ledger_bytes", "peak_ledger_bytes_by_tag", sg_mem_peak);
    if (sg_vram_peak(r->ctx, SG_MEM_TAGS) || json_object_get(r->earlier, "peak_vram_bytes"))
        put_peaks(s, r, "peak_vram_bytes", "peak_vram_bytes_by_tag", sg_vram_peak);
    PUT("stage_seconds", stages(r->trainer));
    PUT("variant", json_string(sg_trainer_variant(r->trainer)));
    PUT("machine", machine());
    COUNT("threads", sg_ctx_threads(r->ctx));
    COUNT("train_views", r->scene->n_train);
    COUNT("test_views", r->scene->n_test);
    COUNT("test_pixels", test_pixels(r->scene));
    if (r->eval.views && r->evaluated == done) {
        PUT("psnr", sg_number_json(r->eval.psnr));
        PUT("ssim", sg_number_json(r->eval.ssim));
        if (r->corrected_by) {
            PUT("corrected_by", json_string(r->corrected_by));
            PUT("corrected_psnr", sg_number_json(r->eval.corrected_psnr));
            PUT("corrected_ssim", sg_number_json(r->eval.corrected_ssim));
        }
    }
    if (r->eval.fps > 0 && r->evaluated == done) { /* timed at the end only */
        PUT("fps", sg_number_json(r->eval.fps));
        PUT("fps_mean", sg_number_json(r->eval.fps_mean));
    }
#undef COUNT
#undef PUT
    return sg_run_write_json(r->ctx, r->params.folder, "summary.json", s);
}
