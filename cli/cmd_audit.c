/* SPDX-License-Identifier: Apache-2.0 */
/* splatguard audit: are these photos poisoned? */
#include "commands.h"
#include "interrupt.h"

struct audit_config {
    struct sg_scene_params scene;
    const char *report;
    bool json, quiet, eval, exit_code;
    int threads;
    uint64_t max_memory;
};

#define A(field) offsetof(struct audit_config, field)
static const struct sg_option audit_options[] = {
    FLAG_ROW("json", A(json), "Print one JSON object.", .group = "Output"),
    TEXT_ROW("report", A(report), "OUT.html",
             "Write a page with the reasons, spectra and heat maps of the most suspicious and the "
             "least suspicious photos.",
             .group = "Output"),
    FLAG_ROW("exit-code", A(exit_code),
             "Exit with status 5 where the photos look poisoned, with 6 where suspicious.",
             .group = "Output"),
    FLAG_ROW("eval", A(eval), "Leave the test views out, as train --eval does.", .group = "Output"),
    NUMBER_ROW("threads", SG_OPTION_INT, A(threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU.", .letter = 'j', .group = "Output"),
    MEMORY_ROW(struct audit_config, max_memory, .group = "Output"),
    FLAG_ROW("quiet", A(quiet), "Only warnings, the verdict and its reasons.", .letter = 'q',
             .group = "Output"),
    {0},
};

static const struct option_part audit_parts[] = {{sg_scene_options, A(scene), "smooth|test-halves"},
                                                 {0}};

static void defaults(void *config)
{
    *(struct audit_config *) config = (struct audit_config){.scene = sg_scene_params_default()};
}

static json_t *features(const struct sg_audit_features *f)
{
    return json_pack("{s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o,s:o}",
                     "content", number_json(f->content), "tv_down", number_json(f->tv_down),
                     "tv_across", number_json(f->tv_across), "osc_down", number_json(f->osc_down),
                     "osc_across", number_json(f->osc_across), "osc_share",
                     number_json(f->osc_share), "osc_quiet", number_json(f->osc_quiet),
                     "osc_chroma", number_json(f->osc_chroma), "half_quiet",
                     number_json(f->half_quiet), "half_osc", number_json(f->half_osc), "half_share",
                     number_json(f->half_share), "quarter_osc", number_json(f->quarter_osc),
                     "quarter_share", number_json(f->quarter_share), "noisy", number_json(f->noisy),
                     "ragged", number_json(f->ragged), "slope", number_json(f->slope), "anisotropy",
                     number_json(f->anisotropy));
}

static json_t *score_json(const struct sg_audit_image *image)
{
    return image->verdict == SG_AUDIT_UNSEEN ? json_null() : number_json(image->score);
}

static int print_json(const struct sg_audit *a)
{
    json_t *images = json_array();
    for (size_t i = 0; i < a->count; i++)
        json_array_append_new(images, json_pack("{s:o,s:o,s:s,s:o,s:o,s:o}", "name",
                                                text_json(a->images[i].name), "score",
                                                score_json(&a->images[i]), "verdict",
                                                sg_audit_verdict_name(a->images[i].verdict), "tau",
                                                number_json(a->images[i].tau), "tau_error",
                                                number_json(a->images[i].tau_error), "features",
                                                features(&a->images[i].features)));
    json_t *reasons = json_array();
    for (size_t i = 0; i < a->count_reasons; i++)
        json_array_append_new(reasons, json_string(a->reasons[i]));
    json_t *counts = json_object();
    for (int v = 0; v < SG_AUDIT_VERDICTS; v++)
        json_object_set_new(counts, sg_audit_verdict_name((enum sg_audit_verdict) v),
                            json_integer((json_int_t) a->verdicts[v]));
    json_t *root = json_pack("{s:s,s:o,s:o,s:o,s:o,s:o,s:o}", "verdict",
                             sg_audit_verdict_name(a->verdict), "score", number_json(a->score),
                             "tau", number_json(a->tau), "tau_error", number_json(a->tau_error),
                             "counts", counts, "reasons", reasons, "images", images);
    return json_print(root, 1);
}

static void print_text(const struct sg_audit *a)
{
    printf("%s: score %.3f; of %zu images %zu poisoned, %zu suspicious, %zu clean",
           sg_audit_verdict_name(a->verdict), a->score, a->count, a->verdicts[SG_AUDIT_POISONED],
           a->verdicts[SG_AUDIT_SUSPICIOUS], a->verdicts[SG_AUDIT_CLEAN]);
    if (a->verdicts[SG_AUDIT_UNSEEN])
        printf(", %zu unseen: masks leave nothing of them", a->verdicts[SG_AUDIT_UNSEEN]);
    printf("\n");
    if (a->tau > 0)
        printf("  amplitude of the poison: about %.0f grey levels (standard error %.0f)\n", a->tau,
               a->tau_error);
    for (size_t i = 0; i < a->count_reasons; i++)
        printf("  %s\n", a->reasons[i]);
}

static int verdict_status(enum sg_audit_verdict verdict)
{
    return verdict == SG_AUDIT_POISONED     ? STATUS_POISONED
           : verdict == SG_AUDIT_SUSPICIOUS ? STATUS_SUSPICIOUS
                                            : STATUS_DONE;
}

static int run_audit(const void *config, const bool *given, const char *const *positional,
                     int count)
{
    (void) given, (void) count;
    struct audit_config c = *(const struct audit_config *) config;
    sg_ctx *ctx;
    struct sg_scene *scene = NULL;
    struct sg_audit *audit = NULL;
    int code = open_context(&ctx, c.threads, c.max_memory, c.quiet);
    if (code)
        return code;
    if (c.report && (code = report(ctx, sg_output_check_file(ctx, c.report)))) {
        sg_ctx_destroy(&ctx);
        return code;
    }
    c.scene.eval = c.eval;
    c.scene.photos_alone = true;
    interrupt_catch();
    int error = sg_scene_load(ctx, positional[0], &c.scene, &scene);
    if (!error)
        error = sg_audit_scene(ctx, scene, &audit);
    if (error)
        code = report(ctx, error);
    else if (c.json)
        code = print_json(audit);
    else
        print_text(audit);
    if (!code && c.report)
        code = report(ctx, sg_audit_write_page(ctx, scene, audit, c.report));
    if (!code && c.report && !c.quiet)
        say(stderr, "page of %zu photos written to %s\n", audit->count, c.report);
    if (!code && c.exit_code)
        code = verdict_status(audit->verdict);
    sg_audit_destroy(&audit);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
    return code;
}

const struct command command_audit = {
    .name = "audit",
    .arguments = "SCENE|PHOTOS [options]",
    .summary = "Tells poisoned photos from clean ones, before training.",
    .description =
        "Looks for the traces that attacks on the cost of training leave: fine "
        "oscillation in whole photos or in parts of them. The exit status is 0 for every verdict, "
        "unless --exit-code is given. PHOTOS is a folder of photos without cameras, or a zip "
        "archive of one.",
    .groups = "Output|Scene",
    .options = audit_options,
    .parts = audit_parts,
    .config_size = sizeof(struct audit_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = 1,
    .run = run_audit,
};
