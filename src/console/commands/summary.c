#include "console/commands/summary.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/text.h"
#include "mechkit/ctrl.h"
#include "mechkit/loop.h"
#include "mechkit/sim.h"

#define RMS_ROWS 50 /* fewer say nothing about how still it is */

static void copy_meta(const struct mk_log *log, const char *key, char *out, size_t size)
{
    const char *value = mk_log_find_meta(log, key);
    mk_show_text(out, size, value ? value : "");
}

/* Rows [first, last) of the last stretch in phase balance. */
static bool last_balance(const double *phase, size_t rows, size_t *first, size_t *last)
{
    size_t end = rows;
    while (end > 0 && phase[end - 1] != MK_PHASE_BALANCE)
        end--;
    if (end == 0)
        return false;
    size_t begin = end;
    while (begin > 0 && phase[begin - 1] == MK_PHASE_BALANCE)
        begin--;
    *first = begin;
    *last = end;
    return true;
}

static double spread(const double *x, size_t first, size_t last)
{
    double sum = 0.0, squares = 0.0;
    size_t n = 0;
    for (size_t i = first; i < last; i++)
        if (!isnan(x[i]))
            sum += x[i], n++;
    double mean = n ? sum / (double)n : 0.0;
    for (size_t i = first; i < last; i++)
        if (!isnan(x[i]))
            squares += (x[i] - mean) * (x[i] - mean);
    return n ? sqrt(squares / (double)n) : (double)NAN;
}

static void summarise_balance(const struct mk_log *log, struct run_summary *r)
{
    const double *t = mk_log_get(log, "t"), *phase = mk_log_get(log, "phase");
    const double *q[] = {mk_log_get(log, "q1"), mk_log_get(log, "q2")};
    size_t first, last;
    if (!phase)
        return;
    for (size_t i = 0; i < log->rows && isnan(r->caught_t); i++)
        if (phase[i] == MK_PHASE_BALANCE)
            r->caught_t = t[i];
    if (!last_balance(phase, log->rows, &first, &last))
        return;
    r->held_s = t[last - 1] - t[first];
    r->balanced_at_end = last + 2 >= log->rows || t[log->rows - 1] - t[last - 1] < 0.05;
    size_t settled = first;
    while (settled < last && t[settled] < t[first] + 1.0)
        settled++;
    const struct mk_plant_info *plant = mk_plant_by_name(r->rig);
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        if (q[j] && settled + RMS_ROWS < last &&
            !(plant && plant->joint_is_wheel[j] && !r->slides[j]))
            r->rms[j] = spread(q[j], settled, last);
}

static void summarise_tracking(const struct mk_log *log, struct run_summary *r)
{
    const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name(r->setup);
    const double *ref = mk_log_get(log, "ref"), *phase = mk_log_get(log, "phase");
    bool of_speed = setup && setup->output && setup->output[0] == 'd';
    const double *v = of_speed ? mk_log_get(log, setup->output) : NULL;
    double squares = 0.0;
    size_t n = 0;
    if (!ref || !v || !phase)
        return;
    const double *t = mk_log_get(log, "t");
    r->steps = step_responses(t, ref, v, log->rows, r->step, SUMMARY_STEPS);
    for (size_t i = log->rows - log->rows / 10; i < log->rows; i++)
        if (!isnan(ref[i]) && !isnan(v[i]) && phase[i] == MK_PHASE_TRACK) {
            squares += (v[i] - ref[i]) * (v[i] - ref[i]);
            n++;
        }
    if (n)
        r->track_rms = sqrt(squares / (double)n);
}

static void summarise_loop(const struct mk_log *log, struct run_summary *r)
{
    const double *late = mk_log_get(log, "late_us"), *flags = mk_log_get(log, "flags");
    for (size_t i = 0; i < log->rows; i++) {
        if (late && !isnan(late[i]))
            r->late_max_us = fmax(r->late_max_us, late[i]);
        if (flags && !isnan(flags[i]))
            r->lost += ((unsigned)flags[i] & (MK_FLAG_LOST | MK_FLAG_OVERRUN)) != 0;
    }
}

static void summarise_column(const double *u, size_t rows, struct summary_command *c)
{
    double squares = 0.0;
    size_t n = 0;
    c->peak = c->rms = (double)NAN;
    for (size_t i = 0; i < rows; i++) {
        if (isnan(u[i]))
            continue;
        c->peak = n ? fmax(c->peak, fabs(u[i])) : fabs(u[i]);
        squares += u[i] * u[i];
        n++;
    }
    if (n)
        c->rms = sqrt(squares / (double)n);
    c->missing = rows - n;
}

/* The command under any of the names that a log may have it (docs/formats.md); what was measured
 * comes before what was sent. */
static void summarise_command(const struct mk_log *log, struct run_summary *r)
{
    static const struct {
        const char *name[MK_MAX_INPUTS];
        bool torque;
    } names[] = {{{"u1", "u2"}, false},
                 {{"tau1", "tau2"}, true},
                 {{"u"}, false},
                 {{"tau"}, true},
                 {{"u1_cmd", "u2_cmd"}, false},
                 {{"tau1_cmd", "tau2_cmd"}, true},
                 {{"u_cmd"}, false},
                 {{"tau_cmd"}, true}};
    const struct mk_plant_info *plant = mk_plant_by_name(r->rig);
    const char *input = mk_log_find_meta(log, "input");
    for (size_t i = 0; i < sizeof names / sizeof names[0] && r->commands == 0; i++)
        for (int k = 0; k < MK_MAX_INPUTS && names[i].name[k]; k++) {
            const double *u = mk_log_get(log, names[i].name[k]);
            if (!u)
                continue;
            struct summary_command *c = &r->command[r->commands++];
            const int joint = k == 0 && plant ? plant->motor_joint : k;
            snprintf(c->name, sizeof c->name, "%s", names[i].name[k]);
            c->unit = !names[i].torque ? "" : r->slides[joint] ? " N" : " N m";
            summarise_column(u, log->rows, c);
        }
    r->undriven = r->commands == 0 && input && strcmp(input, "none") == 0;
}

/* The largest or the mean of values with an infinite one among them says nothing. Columns that are
 * not read here may have what they like. */
static enum mk_status check_finite(const struct mk_log *log, struct mk_error *err)
{
    static const char *const read[] = {
        "q1",   "q2",   "dq1",   "dq2",    "ref",    "u",       "u1",       "u2",       "tau",
        "tau1", "tau2", "u_cmd", "u1_cmd", "u2_cmd", "tau_cmd", "tau1_cmd", "tau2_cmd", "late_us"};
    for (size_t c = 0; c < sizeof read / sizeof read[0]; c++) {
        const double *x = mk_log_get(log, read[c]);
        for (size_t k = 0; x && k < log->rows; k++)
            if (isinf(x[k]))
                return mk_error_at(err, MK_ERR_RANGE, log->path, log->first_row_line + (int)k, 0,
                                   "%s is infinite; a missing value is an empty field or nan",
                                   read[c]);
    }
    return MK_OK;
}

enum mk_status summarise(const char *path, struct run_summary *out, struct mk_error *err)
{
    struct mk_log *log;
    enum mk_status st = mk_log_read(path, &log, err);
    if (st != MK_OK)
        return st;
    st = check_finite(log, err);
    if (st != MK_OK) {
        mk_log_free(log);
        return st;
    }
    memset(out, 0, sizeof *out);
    const double *t = mk_log_get(log, "t");
    out->caught_t = out->track_rms = out->rms[0] = out->rms[1] = (double)NAN;
    out->rows = log->rows;
    out->seconds = t[log->rows - 1] - t[0];
    copy_meta(log, "setup", out->setup, sizeof out->setup);
    copy_meta(log, "rig", out->rig, sizeof out->rig);
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        out->slides[j] = mk_record_joint_slides(log, j);
    copy_meta(log, "fault", out->fault, sizeof out->fault);
    summarise_balance(log, out);
    summarise_tracking(log, out);
    summarise_command(log, out);
    summarise_loop(log, out);
    mk_log_free(log);
    return MK_OK;
}

static size_t add(char *buf, size_t size, size_t used, const char *text)
{
    int n = used < size ? snprintf(buf + used, size - used, "%s", text) : 0;
    return used + (n > 0 ? (size_t)n : 0);
}

const char *summary_unit(const struct run_summary *r, int j)
{
    return r->slides[j] ? "m" : "rad";
}

const char *summary_speed_unit(const struct run_summary *r)
{
    return r->slides[0] ? "m/s" : "rad/s";
}

static size_t add_commands(const struct run_summary *r, char *buf, size_t size, size_t used)
{
    char part[80];
    if (r->commands == 0)
        return add(buf, size, used,
                   r->undriven ? "  nothing drives it" : "  no column for the command");
    for (int i = 0; i < r->commands; i++) {
        const struct summary_command *c = &r->command[i];
        if (isnan(c->peak))
            snprintf(part, sizeof part, "  %s has no values", c->name);
        else
            snprintf(part, sizeof part, c->unit[0] ? "  |%s| <= %.3g%s" : "  |%s| <= %.2f%s",
                     c->name, c->peak, c->unit);
        used = add(buf, size, used, part);
        if (c->missing > 0 && !isnan(c->peak)) {
            snprintf(part, sizeof part, " (%zu missing)", c->missing);
            used = add(buf, size, used, part);
        }
    }
    return used;
}

const char *summary_line(const struct run_summary *r, char *buf, size_t size)
{
    char part[120];
    snprintf(part, sizeof part, "%-22s %6.2f s", r->setup[0] ? r->setup : r->rig, r->seconds);
    size_t used = add(buf, size, 0, part);
    if (!isnan(r->caught_t)) {
        snprintf(part, sizeof part, "  caught at %5.2f s, %s %5.2f s", r->caught_t,
                 r->balanced_at_end ? "held"
                 : r->fault[0]      ? "balanced"
                                    : "lost after",
                 r->held_s);
        used = add(buf, size, used, part);
        int j = isnan(r->rms[1]) ? 0 : 1;
        if (!isnan(r->rms[j])) {
            snprintf(part, sizeof part, " within %.4f %s rms", r->rms[j], summary_unit(r, j));
            used = add(buf, size, used, part);
        }
    }
    if (!isnan(r->track_rms)) {
        snprintf(part, sizeof part, "  speed error %.3f %s rms", r->track_rms,
                 summary_speed_unit(r));
        used = add(buf, size, used, part);
    }
    used = add_commands(r, buf, size, used);
    if (r->late_max_us > 0.0) {
        snprintf(part, sizeof part, "  late %.0f us at most", r->late_max_us);
        used = add(buf, size, used, part);
    }
    if (r->lost) {
        snprintf(part, sizeof part, "  %zu sample%s lost or late", r->lost,
                 r->lost == 1 ? "" : "s");
        used = add(buf, size, used, part);
    }
    if (r->fault[0]) {
        snprintf(part, sizeof part, "  FAULT %.80s", r->fault);
        add(buf, size, used, part);
    }
    return buf;
}
