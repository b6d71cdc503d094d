/* The notebook: what was asked, done and found, in the order in which it happened. Both files are
 * made anew from the journal and the files beside it at every step. */
#include "investigate/notebook.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/out_file.h"
#include "investigate/learn.h"
#include "investigate/picture.h"
#include "mechkit/ident.h"
#include "mechkit/log.h"

#define SIGNAL_SHOWN 200 /* characters of an input in a heading's line */

static const char style[] =
    "<style>:root{color-scheme:light dark;--ink:#1c2330;--soft:#5b6675;--line:#d5dbe3;--page:#fff;"
    "--a:#0b6bcb;--b:#d2571e;--good:#22803f;--bad:#b3261e}"
    "@media(prefers-color-scheme:dark){:root{--ink:#e4e8ee;--soft:#9aa6b6;--line:#39424f;"
    "--page:#14181e;--a:#6cb2ff;--b:#ff9a66;--good:#6cc98a;--bad:#ff8a80}}"
    "body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--page);"
    "max-width:46rem;margin:0 auto;padding:1rem}h1{font-size:1.5rem}h2{font-size:1.15rem;"
    "margin-top:2rem;border-top:1px solid var(--line);padding-top:.8rem}"
    "code{font-size:.85em;overflow-wrap:anywhere}table{border-collapse:collapse;font-size:.9rem;"
    "display:block;overflow-x:auto}td,th{padding:.15rem .6rem .15rem 0;text-align:left;"
    "border-bottom:1px solid var(--line);vertical-align:top}svg{width:100%;height:auto;"
    "font-size:11px;fill:var(--soft)}svg path{fill:none;stroke-width:1.4}.a{stroke:var(--a)}"
    ".b{stroke:var(--b);stroke-dasharray:4 "
    "3}rect.a{fill:var(--a);stroke:none}rect.b{fill:var(--b);stroke:none}"
    "rect.soft{fill:var(--line)}.grid{stroke:var(--line);stroke-width:.7}"
    ".whisker{stroke:var(--ink);stroke-width:1.6}.good{color:var(--good)}.bad{color:var(--bad)}"
    "dt{color:var(--soft);font-size:.85rem}dd{margin:0 0 .4rem}@media print{body{max-width:none}}"
    "</style>";

/* Both files at once, where they say the same. */
struct book {
    const struct journal *j;
    FILE *html, *md;
    struct mk_model now;
    bool have_now;
};

static void both(struct book *b, const char *format, ...) MK_PRINTF(2, 3);
static void both(struct book *b, const char *format, ...)
{
    char text[4096];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    picture_text(b->html, text);
    fputs(text, b->md);
}

static void paragraph(struct book *b, const char *text)
{
    if (!text[0])
        return;
    fputs("<p>", b->html);
    both(b, "%s", text);
    fputs("</p>\n", b->html);
    fputs("\n\n", b->md);
}

static void heading(struct book *b, const char *text)
{
    fputs("<h2>", b->html);
    fputs("## ", b->md);
    both(b, "%s", text);
    fputs("</h2>\n", b->html);
    fputs("\n\n", b->md);
}

/* A term with what is said about it. */
static void said(struct book *b, const char *term, const char *text)
{
    if (!text[0])
        return;
    fprintf(b->html, "<dt>%s</dt><dd>", term);
    fprintf(b->md, "- **%s.** ", term);
    both(b, "%s", text);
    fputs("</dd>\n", b->html);
    fputs("\n", b->md);
}

static void row_begins(struct book *b)
{
    fputs("<tr>", b->html);
    fputs("|", b->md);
}

static void cell(struct book *b, const char *format, ...) MK_PRINTF(2, 3);
static void cell(struct book *b, const char *format, ...)
{
    char text[1400];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    fputs("<td>", b->html);
    both(b, "%s", text);
    fputs("</td>", b->html);
    fputs("|", b->md);
}

static void row_ends(struct book *b)
{
    fputs("</tr>\n", b->html);
    fputs("\n", b->md);
}

static void table_begins(struct book *b, const char *const *title, int count)
{
    fputs("<table><tr>", b->html);
    fputs("|", b->md);
    for (int i = 0; i < count; i++) {
        fprintf(b->html, "<th>%s</th>", title[i]);
        fprintf(b->md, "%s|", title[i]);
    }
    fputs("</tr>\n", b->html);
    fputs("\n|", b->md);
    for (int i = 0; i < count; i++)
        fputs("---|", b->md);
    fputs("\n", b->md);
}

static void table_ends(struct book *b)
{
    fputs("</table>\n", b->html);
    fputs("\n", b->md);
}

/* --- the head --------------------------------------------------------------------------------- */

static double minutes(const struct journal *j, bool of_the_rig)
{
    double s = of_the_rig ? j->look_s + j->control_s : 0.0;
    for (int i = 0; i < j->count; i++)
        s += of_the_rig ? j->experiment[i].rig_s : j->experiment[i].compute_s;
    return s / 60.0;
}

static const struct journal_finding *last_finding(const struct journal *j)
{
    for (int i = j->count - 1; i >= 0; i--)
        if (j->experiment[i].finding.verdict[0])
            return &j->experiment[i].finding;
    return NULL;
}

static void put_head(struct book *b)
{
    const struct journal *j = b->j;
    char text[2000];
    const char *name = mk_plant(j->given.plant)->name;
    fprintf(b->html, "<!doctype html><html lang='en'><meta charset='utf-8'><meta name='viewport' "
                     "content='width=device-width'><title>");
    picture_text(b->html, name);
    fprintf(b->html, ": an investigation</title>%s<h1>", style);
    fputs("# ", b->md);
    both(b, "An investigation of a rig: %s", name);
    fputs("</h1>\n", b->html);
    fputs("\n\n", b->md);
    const char *verdict = j->stopped[0] ? j->stopped_why : "It goes on.";
    fprintf(b->html, "<p class='%s'><strong>",
            strcmp(j->stopped, "validated") == 0 ? "good" : "bad");
    fputs("**", b->md);
    both(b, "%s", verdict);
    fputs("</strong></p>\n", b->html);
    fputs("**\n\n", b->md);
    snprintf(text, sizeof text,
             "Begun %s by %s, from %s, on board %s%s%s. %d experiments; %.2g minutes of the rig's "
             "time, pauses included, and %.2g of calculation.",
             j->begun_at, j->program, j->model_path, j->settings.board,
             j->settings.rig[0] ? " simulating " : "", j->settings.rig, j->count, minutes(j, true),
             minutes(j, false));
    paragraph(b, text);
    const struct journal_finding *f = last_finding(j);
    for (int i = 0; f && i < f->causes; i++) {
        fputs(i ? "" : "<ul>", b->html);
        fputs("<li>", b->html);
        fputs("- ", b->md);
        both(b, "%s", f->cause[i]);
        fputs("</li>\n", b->html);
        fputs("\n", b->md);
    }
    if (f && f->causes > 0) {
        fputs("</ul>\n", b->html);
        fputs("\n", b->md);
    }
    if (f && f->causes == 0)
        paragraph(b, strcmp(f->verdict, "none") == 0
                         ? "The model that was given explains the rig: no cause is claimed."
                         : "No cause is claimed.");
    if (j->looked[0])
        paragraph(b, j->looked);
}

static void put_list(struct book *b)
{
    static const char *const title[] = {"", "kind", "run at", "input", "worst", "then", "minutes"};
    const struct journal *j = b->j;
    if (j->count == 0)
        return;
    heading(b, "The experiments");
    table_begins(b, title, (int)(sizeof title / sizeof title[0]));
    for (int i = 0; i < j->count; i++) {
        const struct experiment *x = &j->experiment[i];
        const bool judged = x->used && x->state >= EXPERIMENT_JUDGED;
        int joint;
        const double worst = judged ? learn_worst(x, &j->given, &joint) : (double)NAN;
        row_begins(b);
        cell(b, "%d", i + 1);
        cell(b, "%s", experiment_kind_name(x->kind));
        cell(b, "%s", x->run_at[0] ? x->run_at : "not yet");
        cell(b, "%.40s%s", x->input, strlen(x->input) > 40 ? "..." : "");
        if (judged)
            cell(b, "%.3g x noise%s", worst, x->passed ? ", passed" : "");
        else
            cell(b, "%s", x->fault);
        cell(b, "%s", x->finding.verdict);
        cell(b, "%.2g", (x->rig_s + x->compute_s) / 60.0);
        row_ends(b);
    }
    table_ends(b);
    paragraph(b, "Worst: error of free runs of the model as it was before the experiment, over the "
                 "noise of the readings, at the joint where it is largest. Passed: within twice "
                 "the noise. Then: the verdict when it was learned from.");
}

/* --- an experiment ---------------------------------------------------------------------------- */

static void put_plots(struct book *b, int number)
{
    const struct journal *j = b->j;
    char name[64], path[JOURNAL_PATH];
    struct mk_log *log = NULL, *predicted = NULL;
    static const char *const angle[MK_MAX_JOINTS] = {"q1", "q2"};
    if (mk_log_read(journal_file(j, path, journal_name(name, number, "-prediction.csv")),
                    &predicted, NULL) == MK_OK &&
        mk_log_read(journal_file(j, path, journal_name(name, number, ".csv")), &log, NULL) ==
            MK_OK) {
        for (int k = 0; k < mk_model_joints(&j->given); k++) {
            char title[60];
            const double *x = mk_log_get(log, "t"), *y = mk_log_get(log, angle[k]);
            const double *px = mk_log_get(predicted, "t"), *py = mk_log_get(predicted, angle[k]);
            if (!x || !y || !px || !py)
                continue;
            snprintf(title, sizeof title, "joint %d, %s", k + 1,
                     mk_model_unit(&j->given, k, "rad"));
            const struct picture_line line[] = {
                {x, y, log->rows, "a", "measured"},
                {px, py, predicted->rows, "b", "written down before"}};
            picture_lines(b->html, line, 2, "t, s", title, 190);
        }
        const double *x = mk_log_get(log, "t"), *u = mk_log_get(log, "u");
        const struct picture_line line = {x, u, log->rows, "a", NULL};
        if (x && u)
            picture_lines(b->html, &line, 1, "t, s", "command", 120);
    }
    mk_log_free(log);
    mk_log_free(predicted);
}

/* Whole ones, none of them -0. */
static double percent(double share)
{
    return rint(100.0 * share) + 0.0;
}

static void put_budget(struct book *b, const struct journal_finding *f)
{
    const struct journal *j = b->j;
    struct picture_bar bar[JOURNAL_ITEMS + 4 * MK_MAX_JOINTS];
    char label[4 * MK_MAX_JOINTS][40];
    int n = 0;
    for (int k = 0; k < mk_model_joints(&j->given); k++) {
        const struct {
            const char *what, *style;
            double value;
        } row[] = {{"given model", "soft", f->given[k]},
                   {"refitted", "soft", f->refit[k]},
                   {"extended", "a", f->extended[k]},
                   {"noise of the readings", "soft", f->noise[k]}};
        for (int i = 0; i < 4; i++) {
            snprintf(label[n], sizeof label[n], "joint %d, %s", k + 1, row[i].what);
            bar[n] = (struct picture_bar){label[n], 1e3 * row[i].value, NAN, NAN, row[i].style};
            n++;
        }
        fprintf(b->md,
                "- Free runs on data held back, joint %d, %s: given %.3g, refitted %.3g, "
                "extended %.3g, noise %.3g\n",
                k + 1, mk_model_unit(&j->given, k, "mrad"), 1e3 * f->given[k], 1e3 * f->refit[k],
                1e3 * f->extended[k], 1e3 * f->noise[k]);
    }
    fputs("<p>Budget of the gap: errors of free runs on data that were held back, and what closes "
          "what refitting leaves.</p>",
          b->html);
    picture_bars(b->html, bar, n, mk_model_unit(&j->given, 0, "mrad"));
    struct picture_bar share[JOURNAL_ITEMS];
    for (int i = 0; i < f->items; i++) {
        share[i] = (struct picture_bar){f->item[i].name, 100.0 * f->item[i].share,
                                        100.0 * f->item[i].low, 100.0 * f->item[i].high, "b"};
        fprintf(b->md, "- %s: %.0f %% of the gap [%.0f .. %.0f]\n", f->item[i].name,
                percent(f->item[i].share), percent(f->item[i].low), percent(f->item[i].high));
    }
    picture_bars(b->html, share, f->items, "%");
}

static void put_experiment(struct book *b, int number)
{
    const struct journal *j = b->j;
    const struct experiment *x = &j->experiment[number];
    const struct journal_finding *f = &x->finding;
    char text[JOURNAL_TEXT + 200];
    snprintf(text, sizeof text, "Experiment %d: %s", number + 1, experiment_kind_name(x->kind));
    heading(b, text);
    fputs("<dl>", b->html);
    said(b, "Why", x->why);
    said(b, "Input", x->input);
    snprintf(text, sizeof text,
             "%s, and written down then: exp-%02d-prediction.csv by "
             "exp-%02d-model.ini",
             x->planned_at, number + 1, number + 1);
    said(b, "Planned", text);
    said(b, "Expected", x->expected);
    if (x->run_at[0])
        snprintf(text, sizeof text, "%s, %.4g s: exp-%02d.csv%s%s", x->run_at, x->ran_s, number + 1,
                 x->fault[0] ? "; stopped: " : "", x->fault);
    said(b, "Run", x->run_at[0] ? text : "not yet");
    said(b, "Came", x->came);
    if (f->verdict[0]) {
        snprintf(text, sizeof text, "verdict %s%s%s", f->verdict,
                 f->open[0] ? "; not told apart: " : "", f->open);
        said(b, "Learned from all so far", text);
        for (int i = 0; i < f->causes; i++)
            said(b, "Cause", f->cause[i]);
        said(b, "Rest", f->rest);
    }
    fputs("</dl>\n", b->html);
    if (x->run_at[0])
        put_plots(b, number);
    if (f->verdict[0])
        put_budget(b, f);
    snprintf(text, sizeof text, "Cost: %.2g minutes of the rig's time, %.2g of calculation.",
             x->rig_s / 60.0, x->compute_s / 60.0);
    fputs("\n", b->md);
    paragraph(b, text);
}

/* --- the model, control ----------------------------------------------------------------------- */

static struct mk_control_figures figures_of(const struct journal_control *c)
{
    return (struct mk_control_figures){.held = c->held ? 1.0 : 0.0,
                                       .caught_s = c->caught_s,
                                       .error = c->sway,
                                       .off = isfinite(c->caught_s) ? 0.0 : (double)NAN};
}

/* Whether a set-up did worse on the rig by the model found than by the given one. */
static bool misleads_control(const struct journal *j)
{
    for (int i = 0; i < j->controls; i++)
        for (int k = 0; k < j->controls; k++) {
            const struct journal_control *given = &j->control[i], *found = &j->control[k];
            struct mk_control_gain gain = {.setup = given->setup, .runs = 1};
            const char *believing;
            if (strcmp(given->setup, found->setup) != 0 || strcmp(given->nominal, "given") != 0 ||
                strcmp(found->nominal, "given") == 0)
                continue;
            gain.given = gain.refit = figures_of(given);
            gain.extended = figures_of(found);
            if (mk_control_gain_worse(&gain, &believing))
                return true;
        }
    return false;
}

static void put_model(struct book *b)
{
    static const char *const title[] = {"parameter", "given", "now", "standard error", "unit"};
    const struct journal *j = b->j;
    const int base = mk_plant(j->given.plant)->parameter_count;
    if (!b->have_now)
        return;
    heading(b, "The model now");
    table_begins(b, title, (int)(sizeof title / sizeof title[0]));
    for (int i = 0; i < mk_model_parameter_count(&b->now); i++) {
        char name[64];
        const struct mk_parameter_info *info =
            mk_model_parameter_info(&b->now, i, name, sizeof name);
        if (i >= base && mk_parameter_goes_without_saying(info, b->now.plant))
            continue;
        row_begins(b);
        cell(b, "%s", name);
        if (i < base)
            cell(b, "%.6g", j->given.parameter[i]);
        else
            cell(b, "-");
        cell(b, "%.6g", mk_model_parameter(&b->now, i));
        if (i < base && b->now.parameter_stderr[i] > 0.0)
            cell(b, "%.2g", b->now.parameter_stderr[i]);
        else
            cell(b, "-");
        cell(b, "%s", mk_model_parameter_unit(&b->now, i));
        row_ends(b);
    }
    table_ends(b);
    paragraph(b,
              misleads_control(b->j)
                  ? "It is model.ini in this folder, for simulate and the next investigation; on "
                    "the rig a controller did better with the given model: leave it that one."
                  : "It is model.ini in this folder, for simulate, the controllers and the next "
                    "investigation.");
}

static void put_control(struct book *b)
{
    static const char *const title[] = {"set-up", "believes",    "held", "caught after, s",
                                        "sway",   "rms command", ""};
    const struct journal *j = b->j;
    if (j->controls == 0)
        return;
    heading(b, "In control, on the rig");
    table_begins(b, title, (int)(sizeof title / sizeof title[0]));
    for (int i = 0; i < j->controls; i++) {
        const struct journal_control *c = &j->control[i];
        row_begins(b);
        cell(b, "%s", c->setup);
        cell(b, "%s model", c->nominal);
        cell(b, "%s", c->held ? "yes" : "no");
        if (isfinite(c->caught_s))
            cell(b, "%.3g", c->caught_s);
        else
            cell(b, "-");
        if (isfinite(c->sway))
            cell(b, "%.3g m%s", 1e3 * c->sway,
                 isfinite(c->caught_s)
                     ? "rad"
                     : mk_model_unit(&j->given, mk_plant(j->given.plant)->motor_joint, "rad/s"));
        else
            cell(b, "-");
        if (isfinite(c->effort))
            cell(b, "%.3g", c->effort);
        else
            cell(b, "-");
        cell(b, "%s", c->fault);
        row_ends(b);
    }
    table_ends(b);
    paragraph(b,
              "Sway: rms of the upright link about its mean from 1 s after the catch; of a set-up "
              "that follows a speed the rms error.");
}

enum mk_status notebook_write(const struct journal *j, struct mk_error *err)
{
    char html_path[JOURNAL_PATH], md_path[JOURNAL_PATH], path[JOURNAL_PATH];
    struct mk_out_text html, md;
    journal_file(j, html_path, "notebook.html");
    journal_file(j, md_path, "notebook.md");
    enum mk_status st = mk_out_text_open(&html, html_path, err);
    if (st != MK_OK)
        return st;
    st = mk_out_text_open(&md, md_path, err);
    if (st != MK_OK) {
        fclose(html.stream);
        free(html.text);
        return st;
    }
    struct book b = {.j = j, .html = html.stream, .md = md.stream};
    b.have_now = mk_model_read(journal_file(j, path, "model.ini"), &b.now, NULL) == MK_OK;
    put_head(&b);
    put_list(&b);
    put_model(&b);
    put_control(&b);
    for (int i = 0; i < j->count; i++)
        put_experiment(&b, i);
    fputs("</html>\n", b.html);
    st = mk_out_text_save(&html, err);
    const enum mk_status second = mk_out_text_save(&md, st == MK_OK ? err : NULL);
    return st == MK_OK ? second : st;
}
