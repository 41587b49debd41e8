/* SPDX-License-Identifier: Apache-2.0 */
/* splatguard view: a page of this machine on which a model or a scene can be looked at. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "interrupt.h"
#include "model_views.h"
#include "view_model.h"
#include "view_pictures.h"
#include "view_scores.h"

struct view_config {
    struct model_options m;
    int port;
    bool open;
};

static const struct sg_option view_options[] = {
    NUMBER_ROW("port", SG_OPTION_INT, offsetof(struct view_config, port), 0, 65535, "N",
               "Port of the page; 0 = any that is free.", .group = "Page"),
    FLAG_ROW("open", offsetof(struct view_config, open), "Open the page in a browser.",
             .group = "Page"),
    MODEL_SCENE_ROW(struct view_config),
    MODEL_OTHER_ROWS(struct view_config),
    MODEL_ENGINE_ROWS(struct view_config),
    {0},
};

static const struct option_part view_parts[] = MODEL_PARTS(struct view_config);

static void defaults(void *config)
{
    *(struct view_config *) config = (struct view_config){.m = model_options_default()};
}

struct viewed {
    sg_ctx *ctx;
    struct sg_run_params run; /* owns texts of the options */
    struct sg_scene *scene;
    struct sg_model *model;
    sg_renderer *renderer;
    struct view_pictures pictures;
    struct view_scores scores;
    bool counted; /* hits too */
    bool trained; /* the model is no scene's points */
};

/* The scene that was named must be there; that of a run may have gone. */
static int load_scene(struct viewed *v, struct model_options *o, bool named)
{
    if (!o->scene_path)
        return STATUS_DONE;
    /* Training views are those of the run. */
    o->scene.eval = !v->run.folder || v->run.scene.eval || o->scene.test_halves;
    o->scene.untrained = true;
    const int error = sg_scene_load(v->ctx, o->scene_path, &o->scene, &v->scene);
    if (!error && !o->scene.eval && v->scene->format == SG_FORMAT_BLENDER) {
        struct sg_scene *whole; /* with its test views, which are apart in any case */
        o->scene.eval = true;
        if (!sg_scene_load(v->ctx, o->scene_path, &o->scene, &whole)) {
            sg_scene_destroy(&v->scene);
            v->scene = whole;
        }
    }
    if (!error || named || error == SG_ERR_INTERRUPTED)
        return report(v->ctx, error);
    say(stderr, "warning: %s; the photos are not shown\n", sg_last_error(v->ctx));
    say_moved(o->scene_path);
    return STATUS_DONE;
}

/* The model of a file or run, or Gaussians at the points of a scene. */
static int load_model(struct viewed *v, const struct model_options *o, const char *path)
{
    int error = SG_OK;
    v->trained = path;
    if (path) {
        error = sg_model_read_drawable(v->ctx, path, UINT32_MAX, &v->model);
        if (!error)
            error = sg_model_check(v->ctx, v->model, path);
    } else if (v->scene->n_points >= 4)
        error = sg_model_init_points(v->ctx, v->scene->points, v->scene->point_colors,
                                     v->scene->n_points, 0, &v->model);
    if (!error && v->model)
        error = sg_renderer_create(v->ctx, o->engine, cpu_variant(o->cpu), v->model, &o->render,
                                   &v->renderer);
    return report_option(v->ctx, &command_view, error);
}

static int open_viewed(struct viewed *v, const char *place, const bool *given,
                       struct view_config *c)
{
    struct model_options *o = &c->m;
    char path[PATH_MAX];
    const bool scene = is_scene(place), named = scene || o->scene_path;
    v->run = sg_run_params_default();
    int code = open_engine_context(&v->ctx, o->threads, o->max_memory, o->max_vram, o->quiet);
    if (!code && scene) {
        if (o->scene_path) {
            say(stderr, "splatguard view: found two scenes, %s and --scene %s, expected one\n",
                place, o->scene_path);
            return STATUS_USAGE;
        }
        if (o->iteration) {
            say(stderr,
                "splatguard view: --iteration: found without effect on the scene %s, expected a "
                "run's folder\n",
                place);
            return STATUS_USAGE;
        }
        o->scene_path = place;
    } else if (!code)
        code = report(v->ctx, sg_run_find_model(v->ctx, place, o->iteration, path, sizeof(path)));
    if (!code && is_run_folder(place))
        code = adopt_run_scene(v->ctx, place, &command_view, given, c, &o->scene, &o->scene_path,
                               &v->run);
    if (!code && !scene)
        code = check_iteration(&command_view, place, o->iteration);
    if (!code)
        code = view_server_find(); /* before anything large is read */
    for (int ch = 0; ch < 3; ch++)
        o->render.background[ch] = o->scene.white_background ? 1 : 0;
    render_as_trained(&o->render, &v->run.train);
    if (!code)
        code = load_scene(v, o, named);
    if (!code)
        code = load_model(v, o, scene ? NULL : path);
    return code;
}

/* A browser's command line can be read by every user of the machine, so the token is in a file that
 * only this user can read, and that leads to the page. Returns its name, which the caller removes
 * and frees, or NULL. */
static char *open_browser(const char *address)
{
    const char *folder = getenv("XDG_RUNTIME_DIR");
    char *path = NULL;
    pid_t child;
    if (asprintf(&path, "%s/splatguard-XXXXXX.html", folder && folder[0] ? folder : "/tmp") < 0)
        return NULL;
    const int fd = mkostemps(path, 5, O_CLOEXEC);
    FILE *f = fd < 0 ? NULL : fdopen(fd, "w");
    if (f) {
        fprintf(f,
                "<!doctype html><meta charset=utf-8><meta http-equiv=refresh content=\"0;url=%s\">"
                "<title>splatguard</title><a href=\"%s\">splatguard</a>\n",
                address, address);
        errno = fclose(f) ? errno : 0;
    }
    /* Without a desktop xdg-open lives as long as the browser: it is not waited for, and Ctrl-C is
     * not for it. */
    char *arguments[] = {(char *) "xdg-open", path, NULL};
    posix_spawnattr_t apart;
    sigset_t ignored; /* here, but not by a browser and what it starts */
    sigemptyset(&ignored);
    sigaddset(&ignored, SIGPIPE);
    sigaddset(&ignored, SIGXFSZ);
    posix_spawnattr_init(&apart);
    posix_spawnattr_setsigdefault(&apart, &ignored);
    posix_spawnattr_setflags(&apart, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGDEF);
    const int error =
        !f || errno ? errno : posix_spawnp(&child, arguments[0], NULL, &apart, arguments, environ);
    posix_spawnattr_destroy(&apart);
    if (error)
        say(stderr, "warning: cannot open a browser: %s\n", strerror(error));
    return path;
}

/* To the browser, where it can draw it. */
static void hand_over_model(struct viewed *v, const struct sg_render_params *render,
                            view_server *server)
{
    const bool fits = view_server_draws() && view_model_fits(v->model, render);
    const int fd = fits ? view_model_write(v->ctx, v->model) : -1;
    if (fd >= 0)
        view_server_set_model(server, fd);
    v->pictures.browser = fd >= 0;
    memcpy(v->pictures.background, render->background, sizeof(render->background));
}

/* Scores in all training views, and hits where they are wanted. */
static int score(struct viewed *v, const struct model_options *o, bool hits)
{
    struct sg_prune_params p = sg_prune_params_default();
    int error = SG_OK;
    p.engine = o->engine, p.cpu = cpu_variant(o->cpu);
    if (!v->scores.model) {
        p.method = SG_PRUNER_SPECTRAL;
        v->counted = false;
        error = view_scores_copy(&v->scores, v->ctx, v->model);
        if (!error)
            error = sg_prune_scores(v->ctx, v->scene, v->model, &p, v->scores.score);
        if (!error)
            error = view_scores_lowest(&v->scores, sg_defense_params_default().rho);
    }
    if (!error && hits && !v->counted) {
        p.method = SG_PRUNER_LIGHTGAUSSIAN, p.score = SG_GLOBAL_COUNT;
        error = sg_prune_scores(v->ctx, v->scene, v->model, &p, v->scores.hits);
        v->counted = !error;
    }
    return error;
}

/* What draws a picture of this kind; NULL: nothing. */
static sg_renderer *renderer_for(struct viewed *v, const struct model_options *o,
                                 enum view_kind kind)
{
    if (kind < VIEW_SCORE)
        return v->renderer;
    if (!v->pictures.scores)
        return NULL;
    int error = score(v, o, kind == VIEW_HITS);
    if (!error)
        error = view_scores_paint(&v->scores, kind, o->engine, cpu_variant(o->cpu), &o->render);
    if (!error)
        return v->scores.renderer;
    if (error != SG_ERR_INTERRUPTED)
        say(stderr, "warning: %s\n", sg_last_error(v->ctx));
    view_scores_clear(&v->scores);
    return NULL;
}

static int serve(struct viewed *v, const struct view_config *c, const char *place)
{
    view_server *server = NULL;
    struct view_ask ask;
    char *redirect = NULL;
    int code = exit_code(sg_ctx_create(
        &v->pictures.own, &(struct sg_ctx_params){.threads = 1, .max_memory = VIEW_MEMORY}));
    v->pictures.ctx = v->ctx, v->pictures.scene = v->scene, v->pictures.model = v->renderer;
    v->pictures.appearances = v->scene && v->model &&
                              sg_model_appearances(v->model) == v->scene->n_train &&
                              c->m.render.appearance == SG_APPEARANCE_MEAN;
    v->pictures.scores = v->pictures.next =
        v->trained && v->scene && v->scene->n_train && !v->model->columns;
    if (!code && !v->scene)
        code = report(v->ctx, view_place_camera(&v->pictures, v->ctx, v->model));
    if (!code)
        code = view_server_open(v->pictures.own, c->port, &server);
    if (!code)
        hand_over_model(v, &c->m.render, server);
    if (!code)
        code = view_publish_scene(&v->pictures, server, place, false);
    if (!code) {
        printf("%s\n", view_server_address(server));
        code = flush_output(STATUS_DONE); /* else nobody would know it */
    }
    if (!code) {
        if (!c->m.quiet)
            say(stderr, "open this address in a browser of this machine; Ctrl-C ends the view\n");
        if (c->open)
            redirect = open_browser(view_server_address(server));
    }
    while (!code && !interrupted())
        if (view_server_next(server, 0.2, &ask))
            view_draw(&v->pictures, server, &ask, renderer_for(v, &c->m, ask.kind));
    if (redirect)
        unlink(redirect);
    free(redirect);
    view_server_close(&server);
    view_pictures_clear(&v->pictures);
    sg_ctx_destroy(&v->pictures.own);
    return code;
}

static int run_view(const void *config, const bool *given, const char *const *positional, int count)
{
    (void) count;
    struct view_config c = *(const struct view_config *) config;
    struct viewed v = {0};
    model_views_warn(&c.m);
    interrupt_catch(); /* before there are files that would be left behind */
    int code = open_viewed(&v, positional[0], given, &c);
    if (!code)
        code = serve(&v, &c, positional[0]);
    view_scores_clear(&v.scores);
    sg_renderer_destroy(&v.renderer);
    if (v.ctx) {
        sg_model_destroy(&v.model);
        sg_scene_destroy(&v.scene);
    }
    sg_ctx_destroy(&v.ctx);
    sg_run_params_clear(&v.run);
    return code;
}

const struct command command_view = {
    .name = "view",
    .arguments = "RUN|MODEL|SCENE [options]",
    .summary = "Shows a model and its photos on a page in the browser.",
    .description =
        "Prints the address of a page on which the model, or the points of a scene, can be looked "
        "at from everywhere and compared with the photos. The page needs no network; only "
        "programs of this machine that know the address reach it. Ctrl-C ends it.",
    .groups = "Page|" MODEL_GROUPS,
    .options = view_options,
    .parts = view_parts,
    .config_size = sizeof(struct view_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = 1,
    .run = run_view,
};
