/* Commands about a run that has ended: identify, explain, compare, replay; and record. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "console/commands/explanation.h"
#include "console/script/cmd_priv.h"
#include "mechkit/explain.h"
#include "mechkit/ident.h"
#include "mechkit/number.h"
#include "mechkit/sim.h"

/* Length of the free runs that a comparison is made of. */
#define COMPARE_S 1.0

static const char *base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

/* The newest log, or the one named. */
static enum mk_status read_run(struct session *s, const char *path, struct mk_log **log,
                               struct mk_error *err)
{
    *log = NULL;
    if (s->running)
        return mk_error_set(err, MK_ERR_STATE, "the run goes on: halt first");
    if (!path && !s->log_path[0])
        return mk_error_set(err, MK_ERR_STATE, "there is no run yet, or it was not logged");
    return mk_log_read(path ? path : s->log_path, log, err);
}

/* What is believed of the rig: the model that a run is held against. */
static enum mk_status nominal_model(const struct session *s, const struct mk_log *log,
                                    struct mk_model *out, struct mk_error *err)
{
    const char *rig = mk_log_find_meta(log, "rig");
    const struct mk_plant_info *plant = rig ? mk_plant_by_name(rig) : NULL;
    if (s->have_nominal)
        *out = s->nominal;
    else if (s->have_model)
        *out = s->model;
    else if (plant)
        mk_model_default(plant->kind, out);
    else
        return mk_error_set(err, MK_ERR_STATE, "which model? say so with model FILE");
    return MK_OK;
}

/* "dir/name.csv" to "dir/name<ending>". */
static void beside(const char *path, const char *ending, char *out, size_t size)
{
    const char *dot = strrchr(path, '.');
    size_t keep = dot && dot > base_name(path) ? (size_t)(dot - path) : strlen(path);
    snprintf(out, size, "%.*s%s", (int)keep, path, ending);
}

static bool on_progress(void *user, double done, const char *what)
{
    struct session *s = user;
    bool go_on = !s->options.progress || s->options.progress(s->options.user, done, what);
    return go_on && session_cancelled(s) == SESSION_GO;
}

/* Lines of a text, one by one. */
static void say_lines(struct session *s, char *text)
{
    char *rest = text, *line;
    while ((line = strsep(&rest, "\n")) != NULL)
        if (*line)
            session_say(s, "%s", line);
}

/* --- identify -------------------------------------------------------------------------------- */

static void say_parameter(struct session *s, const struct mk_ident_parameter *p)
{
    char error[40] = "held";
    if (!p->fixed)
        snprintf(error, sizeof error, isnan(p->std_error) ? "not determined" : "+- %.2g",
                 p->std_error);
    session_say(s, "  %-18s %10.6g -> %10.6g  %s%s", p->name, p->initial, p->value, error,
                p->at_bound ? ", at the edge of what is possible" : "");
}

/* A model takes the place of a model, of an empty file or of none: not of the log that it is fitted
 * to, nor of the script. */
static enum mk_status check_replaces_model(const char *path, struct mk_error *err)
{
    struct stat info;
    struct mk_model model;
    bool unknown[MK_MAX_FIT_PARAMETERS];
    if (stat(path, &info) != 0 || !S_ISREG(info.st_mode) || info.st_size == 0 ||
        mk_model_read_open(path, &model, unknown, NULL) == MK_OK)
        return MK_OK;
    return mk_error_at(err, MK_ERR_INVALID, path, 0, 0,
                       "this file is no model and is not replaced: choose another name");
}

enum mk_status cmd_do_identify(struct session *s, int argc, char **argv, struct mk_error *err)
{
    char path[SESSION_PATH + 16], comment[SESSION_PATH + 64];
    struct mk_log *log;
    struct mk_model model;
    struct mk_ident_options options = {.progress = on_progress, .progress_context = s};
    enum mk_status st = read_run(s, NULL, &log, err);
    if (argc > 0)
        snprintf(path, sizeof path, "%s", argv[0]);
    else
        beside(s->log_path, "-fitted.ini", path, sizeof path);
    if (st == MK_OK)
        st = check_replaces_model(path, err);
    struct mk_ident_result *r = st == MK_OK ? calloc(1, sizeof *r) : NULL;
    if (st == MK_OK && !r)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for the result");
    if (st == MK_OK)
        st = nominal_model(s, log, &model, err);
    if (st == MK_OK)
        st = mk_identify(&model, (const struct mk_log *const *)&log, 1, &options, r, err);
    snprintf(comment, sizeof comment, "mechkit identify: %s, from %s", st == MK_OK ? r->method : "",
             s->log_path);
    if (st == MK_OK)
        st = mk_model_write(path, &r->model, comment, err);
    if (st == MK_OK) {
        session_say(s, "%s in %.1f s: what was believed, and what the run says", r->method,
                    r->seconds);
        for (int i = 0; i < r->parameter_count; i++)
            if (mk_parameter_applies(mk_model_parameter_info(&r->model, i, NULL, 0),
                                     r->model.plant))
                say_parameter(s, &r->parameter[i]);
        for (int i = 0; i < r->warning_count; i++)
            session_say(s, "  %s", r->warning[i]);
        session_say(s, "written to %s; to go on with it: believe %s", path, path);
    }
    free(r);
    mk_log_free(log);
    return st;
}

/* --- explain --------------------------------------------------------------------------------- */

static void say_explanation(struct session *s, const struct mk_explanation *e)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    if (!out)
        return;
    explanation_print(out, e);
    fclose(out);
    say_lines(s, text);
    free(text);
}

/* What a controller does worse with is not offered to it. */
static void say_how_to_go_on(struct session *s, const struct mk_explanation *e, const char *folder)
{
    if (mk_explanation_misleads_control(e)) {
        session_say(s, "written to %s: report.html, extended.ini (for simulation only)", folder);
        return;
    }
    session_say(s, "written to %s: report.html, extended.ini; to go on with it:", folder);
    session_say(s, "  believe %s/extended.ini", folder);
}

enum mk_status cmd_do_explain(struct session *s, int argc, char **argv, struct mk_error *err)
{
    char folder[SESSION_PATH + 16];
    struct mk_log *log;
    struct mk_model model;
    struct mk_explain_options options = {
        .control = true, .progress = on_progress, .progress_context = s};
    enum mk_status st = read_run(s, NULL, &log, err);
    struct mk_explanation *e = st == MK_OK ? calloc(1, sizeof *e) : NULL;
    if (st == MK_OK && !e)
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for the result");
    if (st == MK_OK)
        st = nominal_model(s, log, &model, err);
    if (st == MK_OK)
        st = mk_explain(&model, (const struct mk_log *const *)&log, 1, NULL, 0, &options, e, err);
    if (argc > 0)
        snprintf(folder, sizeof folder, "%s", argv[0]);
    else
        beside(s->log_path, "-explain", folder, sizeof folder);
    const char *held = s->log_path;
    if (st == MK_OK)
        st = explanation_write(folder, "what was believed", e, &held, 1, log, err);
    if (st == MK_OK) {
        say_explanation(s, e);
        say_how_to_go_on(s, e, folder);
    }
    free(e);
    mk_log_free(log);
    return st;
}

/* --- compare, replay ------------------------------------------------------------------------- */

enum mk_status cmd_do_compare(struct session *s, int argc, char **argv, struct mk_error *err)
{
    struct mk_log *log, *prediction = NULL;
    struct mk_model model;
    struct mk_predict_options options = {.window_s = COMPARE_S};
    struct mk_predict_figures figures;
    enum mk_status st = read_run(s, argc > 0 ? argv[0] : NULL, &log, err);
    if (st == MK_OK)
        st = nominal_model(s, log, &model, err);
    if (st == MK_OK)
        st = mk_predict(&model, log, &options, &prediction, &figures, NULL, err);
    if (st != MK_OK) {
        mk_log_free(log);
        return st;
    }
    for (int j = 0; j < mk_model_joints(&model); j++)
        session_say(s, "q%d: simulated %g s from the data each time, off by %.4f %s rms, %.1f %%",
                    j + 1, COMPARE_S, figures.rms[j], mk_model_unit(&model, j, "rad"),
                    100.0 * figures.nrmse[j]);
    if (s->options.show) {
        s->options.show(s->options.user, log, prediction, false);
        return MK_OK;
    }
    mk_log_free(log);
    mk_log_free(prediction);
    return MK_OK;
}

enum mk_status cmd_do_replay(struct session *s, int argc, char **argv, struct mk_error *err)
{
    struct mk_log *log;
    if (!s->options.show)
        return mk_error_set(err, MK_ERR_STATE, "there is no screen to show it: mechkit console");
    enum mk_status st = read_run(s, argc > 0 ? argv[0] : NULL, &log, err);
    if (st == MK_OK)
        s->options.show(s->options.user, log, NULL, true);
    return st;
}

/* --- record ---------------------------------------------------------------------------------- */

static double run_time(const struct session *s)
{
    struct mk_loop_snapshot snap;
    if (!s->loop || !s->running)
        return 0.0;
    mk_loop_get_snapshot(s->loop, &snap);
    return snap.ticks ? snap.sample.t : 0.0;
}

static void stop_recording(struct session *s)
{
    if (s->record)
        fclose(s->record);
    s->record = NULL;
    s->record_path[0] = '\0';
}

static enum mk_status cannot_record(const char *path, int why, struct mk_error *err)
{
    struct stat info;
    if (why != EEXIST || stat(path, &info) != 0)
        return mk_error_errno(err, why, path, "cannot record there");
    if (S_ISREG(info.st_mode))
        return mk_error_at(err, MK_ERR_INVALID, path, 0, 0,
                           "the file exists and is not overwritten: choose another name");
    return mk_error_at(err, MK_ERR_INVALID, path, 0, 0,
                       "this is %s: record to a file that is not there yet",
                       S_ISDIR(info.st_mode) ? "a folder" : "no regular file");
}

enum mk_status cmd_do_record(struct session *s, int argc, char **argv, struct mk_error *err)
{
    (void)argc;
    if (strcmp(argv[0], "off") == 0) {
        if (!s->record)
            return mk_error_set(err, MK_ERR_STATE, "nothing is recorded");
        session_say(s, "recorded to %s; mechkit run %s does it again", s->record_path,
                    s->record_path);
        stop_recording(s);
        return MK_OK;
    }
    stop_recording(s);
    s->record = fopen(argv[0], "wx");
    if (!s->record)
        return cannot_record(argv[0], errno, err);
    setvbuf(s->record, NULL, _IOLBF, 0); /* whole lines, whatever happens */
    snprintf(s->record_path, sizeof s->record_path, "%s", argv[0]);
    if (s->setup && s->ctrl)
        fprintf(s->record, "setup %s\n", s->setup->name);
    s->record_t = run_time(s);
    return MK_OK;
}

void cmd_record_line(struct session *s, const struct cmd_line *line, char *text, size_t size)
{
    double pause = run_time(s) - s->record_t;
    bool waits = strncmp(line->cmd->name, "wait", 4) == 0;
    text[0] = '\0';
    if (strcmp(line->cmd->name, "record") == 0)
        return;
    if (s->running && !waits && pause > 0.05)
        snprintf(text, size, "wait %.2f\n", pause);
    size_t used = strlen(text);
    used += (size_t)snprintf(text + used, size - used, "%s", line->cmd->name);
    for (int i = 0; i < line->argc && used < size; i++) {
        const char *word = line->argv[i];
        bool quote = !line->cmd->raw && (!word[0] || strpbrk(word, " \t#'\""));
        const char *mark = !quote ? "" : strchr(word, '"') ? "'" : "\"";
        used += (size_t)snprintf(text + used, size - used, " %s%s%s", mark, word, mark);
    }
}

void cmd_record(struct session *s, const char *text)
{
    s->record_t = run_time(s);
    if (text[0])
        fprintf(s->record, "%s\n", text);
}
