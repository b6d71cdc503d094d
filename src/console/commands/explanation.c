#include "console/commands/explanation.h"
#include "base/temporary.h"
#include "console/commands/budget.h"
#include "console/commands/data_checks.h"
#include "explain/report/log_value_text.h"
#include "explain/report/places_text.h"
#include "explain/report/sharpness_text.h"
#include "ident/input_report.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "console/commands/left_out.h"

/* What the field calls it, where it usually comes from, what to do. */
static void print_words(FILE *out, const struct mk_effect_info *effect)
{
    const struct mk_effect_words *words = mk_effect_in_words(effect);
    if (words->title)
        fprintf(out, "    That is %s. Usual cause: %s\n    What to do: %s\n", words->title,
                words->usual, words->remedy);
}

static void print_cause(FILE *out, const struct mk_model *model, const struct mk_cause *c)
{
    fprintf(out, "  %s", c->effect->name);
    if (c->joint > 0)
        fprintf(out, " at joint %d", c->joint);
    fprintf(out, ": ");
    for (int k = 0; k < c->effect->parameter_count; k++) {
        if (mk_parameter_goes_without_saying(&c->effect->parameter[k], model->plant))
            continue;
        fprintf(out, "%s%s %.4g", k ? ", " : "", c->effect->parameter[k].name, c->value[k]);
        if (isfinite(c->std_error[k]))
            fprintf(out, " +- %.2g", c->std_error[k]);
        if (c->effect->parameter[k].unit[0])
            fprintf(out, " %s",
                    mk_effect_parameter_unit(model, c->joint, &c->effect->parameter[k]));
    }
    fprintf(out, "\n    evidence: BIC %.0f better with it than without; confidence %.3f\n",
            c->delta_bic, c->confidence);
    print_words(out, c->effect);
}

/* "encoder-offset at joint 1 differs from log to log by 0.038 rad: ..." */
static void print_log_value(FILE *out, const struct mk_explanation *e, const struct mk_cause *c)
{
    for (int k = 0; k < c->effect->parameter_count; k++) {
        const struct mk_parameter_info *info = &c->effect->parameter[k];
        if (!(c->spread[k] > 0.0))
            continue;
        fprintf(out, "  %s", c->effect->name);
        if (c->joint > 0)
            fprintf(out, " at joint %d", c->joint);
        const char *unit = mk_effect_parameter_unit(&e->given, c->joint, info);
        fprintf(out, " has another %s in every log, %.2g%s%s apart (standard deviation):\n   ",
                info->name, c->spread[k], *unit ? " " : "", unit);
        const char *between = "";
        for (int i = 0; i < e->per_log_count; i++)
            if (e->per_log[i].effect == c->effect && e->per_log[i].joint == c->joint) {
                fprintf(out, "%s log %d %.3g +- %.1g", between, e->per_log[i].log + 1,
                        e->per_log[i].value, e->per_log[i].std_error);
                between = ",";
            }
        const char *apart = mk_apart_sentence(e, c);
        if (*apart)
            fprintf(out, "\n    %s", apart);
        fprintf(out, "\n    evidence: BIC %.0f better than one value for all logs\n", c->delta_bic);
        const double held = c->joint > 0 ? e->held_off[c->joint - 1] : 0.0;
        if (strcmp(c->effect->name, "encoder-offset") == 0 && held > 0.0)
            fprintf(out,
                    "    The counters are zeroed where the rig hangs; friction can hold this joint "
                    "%.2g %s from there.\n",
                    held, mk_model_unit(&e->given, c->joint - 1, "rad"));
        print_words(out, c->effect);
    }
}

/* Where to look for a rest without a name. */
static void print_suspects(FILE *out, const struct mk_explanation *e)
{
    if (e->suspect_count > 0)
        fprintf(out, "Suspects: they seem to help on parts of the data that were left out, but not "
                     "surely.\n");
    for (int i = 0; i < e->suspect_count; i++) {
        const struct mk_suspect *s = &e->suspect[i];
        fprintf(out, "  %s", s->effect->name);
        if (s->joint > 0)
            fprintf(out, " at joint %d", s->joint);
        fprintf(out, ": closes %.0f %% of the gap, better in %d of %d parts\n", 100.0 * s->share,
                s->better_in, s->parts);
    }
}

/* Which column drives the rig: a finding where it is not the model's. */
static void print_input(FILE *out, const struct mk_explanation *e)
{
    char what[400];
    if (!e->input.made)
        return;
    mk_input_sentence(&e->input, what, sizeof what);
    fprintf(out, e->input.changed ? "  %s\n" : "Input: %s\n", what);
}

static void print_rivals(FILE *out, const struct mk_explanation *e)
{
    int shown = 0;
    for (int i = 0; i < e->rival_count && shown < 4; i++) {
        const struct mk_rival *r = &e->rival[i];
        fprintf(out, "  %s %s", shown ? "      " : "rivals:", r->effect->name);
        if (r->joint > 0)
            fprintf(out, " at joint %d", r->joint);
        if (e->cause_count > 1 && r->instead_of >= 0 && r->instead_of < e->cause_count) {
            const struct mk_cause *c = &e->cause[r->instead_of];
            fprintf(out, " instead of %s", c->effect->name);
            if (c->joint > 0)
                fprintf(out, " at joint %d", c->joint);
        }
        fprintf(out,
                r->distinguishable ? ", BIC %.0f worse\n"
                                   : ", BIC %.1f apart: the data cannot tell them apart\n",
                r->distinguishable ? r->delta_bic : fabs(r->delta_bic));
        shown++;
    }
}

/* What was wrong, where that is values only: also those of effects the given model has. */
static void print_values(FILE *out, const struct mk_explanation *e)
{
    const struct mk_plant_info *plant = mk_plant(e->given.plant);
    for (int i = 0; i < plant->parameter_count; i++) {
        fprintf(out, "  %s: given ", plant->parameter[i].name);
        fprintf(out, e->unknown[i] ? "?" : "%.4g", e->given.parameter[i]);
        fprintf(out, ", refitted %.4g", e->refit.parameter[i]);
        if (isfinite(e->std_error[i]))
            fprintf(out, " +- %.2g", e->std_error[i]);
        fprintf(out, "\n");
    }
    for (int i = 0; i < e->given.effect_count; i++) {
        const struct mk_effect_use *given = &e->given.effect[i], *refit = &e->refit.effect[i];
        const struct mk_effect_info *info = mk_effect(given->index);
        for (int k = 0; k < info->parameter_count; k++)
            if (!mk_parameter_goes_without_saying(&info->parameter[k], plant->kind))
                fprintf(out, "  %s, %s: given %.4g, refitted %.4g\n", info->name,
                        info->parameter[k].name, given->value[k], refit->value[k]);
    }
}

/* Of the whiteness tests, the one that says most against. */
static void print_one_step(FILE *out, const struct mk_explanation *e)
{
    double p = 1.0;
    for (int i = 0; i < e->residual_test_count; i++)
        p = fmin(p, e->residual_test[i].p_after);
    p = fmin(1.0, p * e->residual_test_count); /* Bonferroni */
    if (e->residual_test_count == 0)
        return;
    fprintf(out, "One-step predictions, error over what is expected of a right model:\n ");
    for (int j = 0; j < mk_model_joints(&e->given); j++)
        fprintf(out, "%s q%d refitted %.3g, extended %.3g", j ? ";" : "", j + 1,
                e->one_step_refit[j], e->one_step_extended[j]);
    fprintf(out,
            p > 0.01 ? "; what is left is white and goes with nothing (p %.2g)\n"
                     : "; what is left is not white noise (p %.1g)\n",
            p);
}

static void print_figure(FILE *out, double value, const char *after)
{
    if (isfinite(value))
        fprintf(out, " %.3g%s", value, after);
    else
        fprintf(out, " -%s", after);
}

/* A line a setup; a belief that held in no run has no figures. */
static void print_control(FILE *out, const struct mk_explanation *e)
{
    if (e->control_count > 0)
        fprintf(out,
                "In control, on a virtual rig that is the extended model (believing the given, "
                "refitted, extended one):\n");
    for (int i = 0; i < e->control_count; i++) {
        const struct mk_control_gain *c = &e->control[i];
        const struct mk_control_figures *f[] = {&c->given, &c->refit, &c->extended};
        bool tracks = isnan(f[0]->off) && isnan(f[1]->off) && isnan(f[2]->off);
        fprintf(out, "  %s: held %.0f, %.0f, %.0f of %d; %s", c->setup, f[0]->held * c->runs,
                f[1]->held * c->runs, f[2]->held * c->runs, c->runs,
                tracks ? "speed error" : "sway");
        for (int k = 0; k < 3; k++)
            print_figure(out, tracks ? f[k]->error : 1e3 * f[k]->error, k < 2 ? "," : "");
        fprintf(out, " %s; rms command", mk_model_unit(&e->given, -1, tracks ? "rad/s" : "mrad"));
        for (int k = 0; k < 3; k++)
            print_figure(out, f[k]->effort, k < 2 ? "," : "\n");
        const char *believing, *worse = mk_control_gain_worse(c, &believing);
        if (worse)
            fprintf(out,
                    "    Believing the extended model it %s than believing the %s one: take the "
                    "extended model\n    for simulation only, and leave the controller the %s "
                    "one.\n",
                    worse, believing, believing);
    }
}

static void print_declined(FILE *out, const struct mk_explanation *e)
{
    if (!isfinite(e->declined[0])) {
        fprintf(out, "  The extension found is not offered: its free runs run away.\n");
        return;
    }
    fprintf(out, "  The extension found is not offered: it would leave");
    for (int j = 0; j < mk_model_joints(&e->given); j++) {
        /* Both are shares of the same deviation of the readings, which the budget has in the unit.
         */
        const double refit = 1e3 * e->budget.refit[j];
        fprintf(out, "%s %.3g %s at joint %d where refitting leaves %.3g", j ? "," : "",
                refit * e->declined[j] / e->refitted[j], mk_model_unit(&e->given, j, "mrad"), j + 1,
                refit);
    }
    fprintf(out, ".\n");
}

/* The first of the catalogue are the commonest; the report has all. */
static void print_limits(FILE *out, const struct mk_explanation *e)
{
    enum { SHOWN = 4 };
    for (int i = 0; i < e->detection_limit_count && i < SHOWN; i++) {
        const struct mk_detection_limit *l = &e->detection_limit[i];
        const struct mk_parameter_info *p = &l->effect->parameter[l->parameter];
        fprintf(out, "%s%s", i ? "; " : "Would have been seen: ", l->effect->name);
        if (l->joint > 0)
            fprintf(out, " at joint %d", l->joint);
        fprintf(out, " above %.2g %s", l->least, mk_effect_parameter_unit(&e->given, l->joint, p));
    }
    if (e->detection_limit_count > 0)
        fprintf(out, "%s\n", e->detection_limit_count > SHOWN ? "; ..." : "");
}

static const char *sentence(const struct mk_explanation *e)
{
    static const char *const sentences[] = {
        "The model explains the data.",
        "Only values of parameters were wrong; the structure of the model is right.",
        "Something is missing in the model, and has a name.",
        "Something is missing in the model. A part of it has a name, a rest has none.",
        "Something is missing in the model that no known effect explains:"};
    if (e->verdict == MK_VERDICT_PARTIAL && mk_explanation_leaves_little(e))
        return "Something is missing in the model, and has a name; a small rest has none.";
    if (e->verdict != MK_VERDICT_UNKNOWN || e->cause_count == 0)
        return sentences[e->verdict];
    if (!e->offered)
        return "Something is missing in the model that no known effect explains; this fits what "
               "was learned from, but not the held-out data:";
    return e->partly_named ? "Something is missing in the model. Known effects explain a part of "
                             "it, the rest has no name; the part:"
                           : sentences[e->verdict];
}

/* Noise on which any model is as good as any other. */
static bool drowns(const struct mk_explanation *e)
{
    const double most = 0.3;
    bool all = true;
    for (int j = 0; j < mk_model_joints(&e->given); j++)
        all = all && e->floor[j] > most;
    return all;
}

/* What was found: causes, values that differ, what else it could be. */
static void print_places(FILE *out, const struct mk_explanation *e)
{
    char what[4096];
    mk_places_sentence(e, what, sizeof what);
    if (what[0])
        fprintf(out, "  %s\n", what);
}

static void print_found(FILE *out, const struct mk_explanation *e)
{
    if (e->input.changed)
        print_input(out, e);
    print_places(out, e);
    if (e->verdict == MK_VERDICT_EFFECT || e->verdict == MK_VERDICT_PARTIAL)
        for (int i = 0; i < e->cause_count - e->piece_count; i++)
            print_cause(out, &e->given, &e->cause[i]);
    if (e->verdict == MK_VERDICT_PARTIAL && e->structure[0])
        fprintf(out, "  and a torque that has no name: %s\n", e->structure);
    for (int i = 0; i < e->log_value_count; i++)
        print_log_value(out, e, &e->log_value[i]);
    if (e->verdict == MK_VERDICT_PARAMETERS)
        print_values(out, e);
    print_rivals(out, e);
    print_suspects(out, e);
    if (!e->input.changed)
        print_input(out, e);
}

/* What is to be kept in mind about data and model. */
static void print_reservations(FILE *out, const struct mk_explanation *e)
{
    if (e->scale_free)
        fprintf(
            out,
            "No command acts in these data: they show ratios of inertias, weights and frictions "
            "only. %s is\nheld at its given value %g, and all torques are counted in it.\n",
            mk_plant(e->given.plant)->parameter[e->scale_holder].name,
            e->given.parameter[e->scale_holder]);
    if (e->verdict >= MK_VERDICT_EFFECT)
        for (int j = 0; j < mk_model_joints(&e->given); j++)
            fprintf(out, "  residual torque in the equation of joint %d: %.3g %s rms\n", j + 1,
                    e->missing[j], mk_model_unit(&e->given, j, "N m"));
    char sharpness[160];
    mk_sharpness_sentence(e, sharpness, sizeof sharpness);
    if (sharpness[0])
        fprintf(out, "  %s\n", sharpness);
    if (e->searched_s < 0.99 * e->given_s)
        fprintf(out, "Searched in %.0f of %.0f s of data (--seconds all: in everything).\n",
                e->searched_s, e->given_s);
    for (int i = 0; i < mk_plant(e->given.plant)->parameter_count; i++)
        if (mk_explanation_doubts_mass(e, i))
            fprintf(out,
                    "  %s is fitted as %.3g, given as %.3g: nobody weighs so badly, and something "
                    "that the model\n  lacks may be in its place.\n",
                    mk_plant(e->given.plant)->parameter[i].name,
                    (e->offered ? &e->extended : &e->refit)->parameter[i], e->given.parameter[i]);
    if (drowns(e))
        fprintf(out, "  The readings scatter nearly as much as they move: little can be seen in "
                     "such data.\n");
    if (mk_explanation_doubts_logs(e))
        fprintf(out,
                "  The given model predicts them better than the refitted one: are all logs of "
                "the same rig, with the same signs, units and columns?\n");
    if (e->held_counts_corrected > 0)
        fprintf(
            out,
            "  Missed counts were corrected in the held-out data as well, %d of them: the errors "
            "above are without.\n",
            e->held_counts_corrected);
    if (mk_explanation_goes_beyond(e))
        fprintf(
            out,
            "  Held-out data are predicted far worse than they are read, and their commands are "
            "up to %.2g times\n  the largest one to learn from: a limit or a stop that only they "
            "meet is in no model. Learn from such data too.\n",
            e->command_beyond);
    else if (mk_explanation_misses_held_out(e))
        fprintf(out,
                "  Held-out data are predicted far worse than they are read: they may show what "
                "the other logs do not. Learn from such data too.\n");
}

void explanation_print(FILE *out, const struct mk_explanation *e)
{
    data_checks_print(out, &e->data_check);
    left_out_print(out, e->left_out, e->left_out_count);
    fprintf(out, "%s\n", sentence(e));
    if (e->verdict == MK_VERDICT_UNKNOWN)
        fprintf(out, "  %s\n", e->structure);
    budget_print(out, e);
    print_found(out, e);
    print_reservations(out, e);
    /* The budget says it joint by joint. */
    if (e->offered && e->budget.item_count == 0)
        fprintf(out, "  The extension closes %.1f %% of what refitting leaves.\n",
                100.0 * e->closed);
    else if (!e->offered && e->cause_count + e->log_value_count + e->input.changed > 0)
        print_declined(out, e);
    print_limits(out, e);
    print_control(out, e);
    print_one_step(out, e);
    if (e->next.why[0])
        fprintf(out, "Next: %s\n", e->next.why);
    fprintf(out, "%.1f s\n", e->seconds);
}

enum mk_status explanation_make_folder(const char *path, bool *made, struct mk_error *err)
{
    struct stat info;
    *made = false;
    if (!path[0])
        return mk_error_set(err, MK_ERR_USAGE, "the folder of the report has an empty name");
    if (mkdir(path, 0777) == 0) {
        *made = true;
        return MK_OK;
    }
    if (errno != EEXIST)
        return mk_error_errno(err, errno, path, "cannot make the folder");
    if (stat(path, &info) != 0 || !S_ISDIR(info.st_mode))
        return mk_error_at(err, MK_ERR_IO, path, 0, 0,
                           "this is no folder: the report is several files");
    if (access(path, W_OK | X_OK) != 0)
        return mk_error_errno(err, errno, path, "cannot write to the folder");
    return MK_OK;
}

/* --- the files ---------------------------------------------------------------------------- */

#define PATH_BYTES 4096

/* report.json comes last: where it is, the report is whole. */
enum { EXTENDED, NEXT, HTML, JSON, FILES };
static const char *const names[FILES] = {"extended.ini", "next.cmd", "report.html", "report.json"};

static const char *in(char path[PATH_BYTES], const char *folder, const char *name)
{
    /* What does not fit is no path: nothing can be opened there. */
    if (snprintf(path, PATH_BYTES, "%s/%s", folder, name) >= PATH_BYTES)
        path[0] = '\0';
    return path;
}

struct parts {
    const char *model; /* where it came from */
    const struct mk_explanation *e;
    const char *const *holdouts;
    size_t holdout_count;
    const struct mk_log *shown;
};

static enum mk_status write_part(const struct parts *p, int file, const char *path,
                                 struct mk_error *err)
{
    char comment[256];
    switch (file) {
    case EXTENDED:
        snprintf(comment, sizeof comment, "mechkit explain: verdict %s, from %s",
                 mk_verdict_name(p->e->verdict), p->model);
        return mk_model_write(path, &p->e->extended, comment, err);
    case NEXT:
        return mk_explanation_write_next(p->e, path, names[EXTENDED], err);
    case HTML:
        return mk_explanation_write_html(p->e, path, p->shown, err);
    default:
        return mk_explanation_write_json(p->e, path, p->holdouts, p->holdout_count, err);
    }
}

/* All of a report or nothing, and of two that are written to one folder at a time one or the other;
 * where the file system cannot lock, the last file of each. */
static enum mk_status move_parts(const char *from, const char *folder, bool has_next,
                                 struct mk_error *err)
{
    char old[PATH_BYTES], new[PATH_BYTES];
    enum mk_status st = MK_OK;
    int lock = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (lock >= 0)
        (void)!flock(lock, LOCK_EX);
    /* Files of an earlier report would not belong to this one. */
    for (int file = JSON; file >= NEXT && st == MK_OK; file--)
        if ((file == JSON || (file == NEXT && !has_next)) &&
            unlink(in(new, folder, names[file])) != 0 && errno != ENOENT)
            st = mk_error_errno(err, errno, new, "cannot remove the earlier report");
    for (int file = 0; file < FILES && st == MK_OK; file++)
        if ((file != NEXT || has_next) &&
            rename(in(old, from, names[file]), in(new, folder, names[file])) != 0)
            st = mk_error_errno(err, errno, new, "cannot write");
    if (lock >= 0)
        close(lock);
    return st;
}

/* All parts to the folder `aside`, and from there at once. */
static enum mk_status write_and_move(const struct parts *p, const char *aside, const char *folder,
                                     struct mk_error *err)
{
    char path[PATH_BYTES];
    enum mk_status st = MK_OK;
    if (strlen(aside) + sizeof "/extended.ini.1234567-1000.tmp" > PATH_BYTES)
        return mk_error_errno(err, ENAMETOOLONG, folder, "cannot write to the folder");
    for (int file = 0; file < FILES && st == MK_OK; file++) {
        st = write_part(p, file, in(path, aside, names[file]), err);
        if (st != MK_OK && err)
            snprintf(err->file, sizeof err->file, "%.255s", in(path, folder, names[file]));
    }
    return st == MK_OK ? move_parts(aside, folder, p->e->next.input[0] != '\0', err) : st;
}

enum mk_status explanation_write(const char *folder, const char *model,
                                 const struct mk_explanation *e, const char *const *holdouts,
                                 size_t holdout_count, const struct mk_log *shown,
                                 struct mk_error *err)
{
    const struct parts parts = {model, e, holdouts, holdout_count, shown};
    struct mk_temporary_folder aside;
    bool made;
    enum mk_status st = explanation_make_folder(folder, &made, err);
    if (st != MK_OK)
        return st;
    st = mk_temporary_folder_open(&aside, folder, ".report", err);
    if (st == MK_OK) {
        st = write_and_move(&parts, aside.path, folder, err);
        mk_temporary_folder_close(&aside);
    }
    if (st != MK_OK && made)
        (void)rmdir(folder);
    return st;
}
