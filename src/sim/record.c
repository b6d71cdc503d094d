/* A log in a model's terms: which column is what, and the state of the rig at a row.
 *
 * A record (struct mk_record) is a set of pointers into the log, which owns the data and has to
 * outlive it: nothing is copied, and nothing has to be freed. Logs have columns under several names
 * (docs/formats.md); what a model needs and a log lacks is an error with the reason.
 *
 * The state at a row comes from the angles alone. Around row r a polynomial of degree 4 in time,
 *     q(t) ~ sum_i c_i s^i ,   s = (t - t_r) / scale ,
 * is fitted to the readings of a neighbourhood by least squares. Its value and slope at the row are
 *     q = c_0 ,   v = c_1 / scale .
 * How wide? With m readings of noise sigma over a width w the error of v by noise is of the order
 * of sigma / (w sqrt(m)), so that it falls with w; what the polynomial misses of the motion grows
 * with w. The widest neighbourhood wins whose residual is still what the encoder's noise explains:
 * the width follows the motion, and no bandwidth has to be given. This is a first guess for fits,
 * which find better states (sim/start_state.cpp).
 */
#include "mechkit/number.h"
#include "mechkit/sim.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "mechkit/number.h"

/* --- columns ----------------------------------------------------------------------------- */

static enum mk_status missing(const struct mk_log *log, struct mk_error *err, const char *what)
{
    bool ours = mk_log_find_meta(log, "mechkit-log") != NULL;
    return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0, "the log has no column %s%s", what,
                       ours ? ""
                            : "; mechkit import makes a log of another program's file, and says "
                              "which column is which");
}

/* Whether a log is of a rig that nothing drives, so that its command is 0 without a column. */
static bool nothing_drives(const struct mk_log *log, const struct mk_model *model)
{
    const char *input = mk_log_find_meta(log, "input");
    return model->no_motor || (input && strcmp(input, "none") == 0);
}

/* A command where there is said to be none: one of the two is wrong. */
static enum mk_status check_undriven(const struct mk_log *log, const struct mk_model *model,
                                     const struct mk_record *record, struct mk_error *err)
{
    for (int i = 0; i < MK_MAX_INPUTS && nothing_drives(log, model); i++)
        for (size_t k = 0; record->u[i] && k < record->rows; k++)
            if (fabs(record->u[i][k]) > 0.0)
                return mk_error_at(
                    err, MK_ERR_PARSE, log->path, log->first_row_line + (int)k, 0,
                    "the command is %g, but %s says that nothing drives the rig", record->u[i][k],
                    model->no_motor ? "`motor = none` in the model" : "`# input: none` in the log");
    return MK_OK;
}

/* Where a log may have its command (docs/formats.md). */
struct command_names {
    const char *one, *two; /* NULL: for one motor only */
    bool si;
};
static const struct command_names measured_names[] = {
    {"u1", "u2", false}, {"tau1", "tau2", true}, {"u", NULL, false}, {"tau", NULL, true}};
static const struct command_names commanded_names[] = {{"u1_cmd", "u2_cmd", false},
                                                       {"tau1_cmd", "tau2_cmd", true},
                                                       {"u_cmd", NULL, false},
                                                       {"tau_cmd", NULL, true}};
#define COMMAND_NAMES (sizeof measured_names / sizeof measured_names[0])

/* The first of the names that the log has; -1: none. */
static int find_names(const struct mk_log *log, const struct command_names *names)
{
    for (size_t i = 0; i < COMMAND_NAMES; i++)
        if (mk_log_get(log, names[i].one))
            return (int)i;
    return -1;
}

/* No column that the model asks for: an error, unless nothing drives the rig. */
static enum mk_status no_command(const struct mk_log *log, const struct mk_model *model,
                                 struct mk_error *err)
{
    const int measured = find_names(log, measured_names);
    if (nothing_drives(log, model))
        return MK_OK;
    if (model->input == MK_INPUT_COMMANDED)
        return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0,
                           "the log has no column u_cmd, tau_cmd, or u1_cmd/tau1_cmd, which "
                           "`input = commanded` in the model asks for: without that line the "
                           "measured %s is taken",
                           measured < 0 ? "command" : measured_names[measured].one);
    return missing(log, err,
                   "u (the command), tau, or u1/tau1: one of them is needed. If nothing "
                   "drove "
                   "the rig, say so: `motor = none` in [rig] of the model, or `# input: "
                   "none` in "
                   "the log (mechkit import: `input = none` in [rig] of the mapping)");
}

/* The motor's command, and where two motors drive the rig that of joint 2. */
static enum mk_status find_commands(const struct mk_log *log, const struct mk_model *model,
                                    struct mk_record *out, struct mk_error *err)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    const bool commanded = model->input == MK_INPUT_COMMANDED;
    const struct command_names *names = commanded ? commanded_names : measured_names;
    const int found = find_names(log, names);
    if (found < 0)
        return no_command(log, model, err);
    const bool takes_two = plant->joints == 2 && plant->motor_joint == 0 && names[found].two;
    out->u[0] = mk_log_get(log, names[found].one);
    out->u[1] = takes_two ? mk_log_get(log, names[found].two) : NULL;
    out->si = names[found].si;
    const bool lacks_one = takes_two && !out->u[1] && find_names(log, measured_names) == found &&
                           mk_log_get(log, measured_names[found].two);
    if (commanded && lacks_one)
        return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0,
                           "the log has no column %s beside %s, which `input = commanded` in the "
                           "model asks for: what joint 2 was sent is not known",
                           names[found].two, names[found].one);
    return MK_OK;
}

/* joint_unit has a word for each joint, blanks or commas between them: the word of `joint` is found
 * by skipping as many. A joint without a word turns. */
bool mk_record_joint_slides(const struct mk_log *log, int joint)
{
    const char *at = mk_log_find_meta(log, "joint_unit");
    for (int j = 0; at && j < joint; j++) {
        at += strcspn(at, " \t,");
        at += strspn(at, " \t,");
    }
    return at && *at == 'm';
}

/* One word a joint behind the key. */
static enum mk_status describe(struct mk_log *log, const struct mk_model *model, const char *key,
                               void (*word)(const struct mk_model *, int, char *, size_t))
{
    char text[2 * MK_NUMBER_MAX + 2] = "";
    for (int j = 0; j < mk_model_joints(model); j++) {
        size_t used = strlen(text);
        if (j > 0)
            text[used++] = ' ';
        word(model, j, text + used, sizeof text - used);
    }
    return mk_log_set_meta(log, key, text);
}

static void unit_word(const struct mk_model *model, int joint, char *text, size_t size)
{
    snprintf(text, size, "%s", mk_model_unit(model, joint, "rad"));
}

static void cpr_word(const struct mk_model *model, int joint, char *text, size_t size)
{
    snprintf(text, size, "%d", model->encoder_cpr[joint]);
}

static void count_word(const struct mk_model *model, int joint, char *text, size_t size)
{
    snprintf(text, size, "%.9g", mk_model_count(model, joint));
}

/* Counts are told as counts a revolution where all joints have that, else as the size of a count in
 * the joint's unit, which says it of joints that slide as well. */
enum mk_status mk_record_describe_joints(struct mk_log *log, const struct mk_model *model,
                                         bool counts)
{
    bool slides = false, turns = true;
    for (int j = 0; j < mk_model_joints(model); j++) {
        slides = slides || model->joint_linear[j];
        turns = turns && model->encoder_cpr[j] > 0;
    }
    enum mk_status st = slides ? describe(log, model, "joint_unit", unit_word) : MK_OK;
    if (st == MK_OK && counts)
        st = turns ? describe(log, model, "encoder_cpr", cpr_word)
                   : describe(log, model, "encoder_resolution", count_word);
    return st;
}

/* A log that says nothing is in the model's units. */
static enum mk_status check_units(const struct mk_log *log, const struct mk_model *model,
                                  struct mk_error *err)
{
    const char *at = mk_log_find_meta(log, "joint_unit");
    for (int j = 0; at && *at && j < mk_model_joints(model); j++) {
        size_t length = strcspn(at, " \t,");
        const char *unit = mk_model_unit(model, j, "rad");
        if (strlen(unit) != length || strncmp(at, unit, length) != 0)
            return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0,
                               "joint %d is in %.*s in the log, in %s in the model: joint_unit in "
                               "the model's [rig] says which",
                               j + 1, (int)length, at, unit);
        at += length;
        at += strspn(at, " \t,");
    }
    return MK_OK;
}

/* When the run began; a log that was read has been checked, one that was made in memory has not. */
static enum mk_status take_begins(const struct mk_log *log, struct mk_record *out,
                                  struct mk_error *err)
{
    const char *begins = mk_log_find_meta(log, "begins_s");
    out->begins = log->rows > 0 ? out->t[0] : 0.0;
    if (!begins || (mk_parse_double_z(begins, &out->begins) && isfinite(out->begins)))
        return MK_OK;
    return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0,
                       "begins_s: '%.40s' is no time: expected when the run began, in s", begins);
}

/* In the order in which a wrong file shows: rig, units, times, angles, command. Where the command
 * comes as a torque (tau, in N m) u_to_torque is 1, and the model's parameters are SI
 * (docs/theory.md, section 1). A board's own clock makes samples on time, so that `late_us` of such
 * a log says nothing of when readings were taken. */
enum mk_status mk_record_from_log(const struct mk_log *log, const struct mk_model *model,
                                  struct mk_record *out, struct mk_error *err)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    memset(out, 0, sizeof *out);
    const char *rig = mk_log_find_meta(log, "rig");
    if (rig && *rig && strcmp(rig, plant->name) != 0)
        return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0,
                           "the log is of the rig %s, the model of %s", rig, plant->name);
    enum mk_status st = check_units(log, model, err);
    if (st != MK_OK)
        return st;
    out->rows = log->rows;
    out->t = mk_log_get(log, "t");
    if (!out->t)
        return missing(log, err, "t");
    st = take_begins(log, out, err);
    if (st != MK_OK)
        return st;
    for (int j = 0; j < plant->joints; j++) {
        out->q[j] = mk_log_get(log, mk_log_angle(j));
        if (!out->q[j])
            return missing(log, err, mk_log_angle(j));
    }
    out->left_out = mk_log_get(log, "left_out");
    out->flags = mk_log_get(log, "flags");
    const char *clock = mk_log_find_meta(log, "clock");
    out->board_clock = clock && strcmp(clock, "board") == 0;
    out->late_us = out->board_clock ? NULL : mk_log_get(log, "late_us");
    st = find_commands(log, model, out, err);
    if (st == MK_OK)
        st = check_undriven(log, model, out, err);
    out->u_to_torque = out->si ? 1.0 : model->u_to_torque;
    return st;
}

/* --- state at a row ---------------------------------------------------------------------- */

#define DEGREE 4
#define TERMS (DEGREE + 1)

/* Readings around a row. t0 is the time of the row and `scale` the distance to its farther end, s,
 * so that |s| <= 1 and the normal equations are as well conditioned as powers allow. */
struct neighbourhood {
    const double *t, *q;
    size_t first, last; /* rows [first, last) */
    double t0, scale;
};

/* Solves A x = b for n <= TERMS unknowns by Cholesky, A = L L', of which only the lower triangle is
 * read. Column by column
 *     L_jj = sqrt(A_jj - sum_(k<j) L_jk^2) ,   L_ij = (A_ij - sum_(k<j) L_ik L_jk) / L_jj ,
 * then L y = b forwards and L' x = y backwards. A becomes L, b becomes x. False when a pivot is
 * next to nothing: entries of A are sums of powers of |s| <= 1 over the readings, so that an
 * absolute bound does. */
static bool solve_normal(int n, double a[TERMS][TERMS], double *b)
{
    for (int j = 0; j < n; j++) {
        for (int k = 0; k < j; k++)
            for (int i = j; i < n; i++)
                a[i][j] -= a[i][k] * a[j][k];
        if (!(a[j][j] > 1e-12))
            return false;
        double root = sqrt(a[j][j]);
        for (int i = j; i < n; i++)
            a[i][j] /= root;
    }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++)
            b[i] -= a[i][k] * b[k];
        b[i] /= a[i][i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= a[k][i] * b[k];
        b[i] /= a[i][i];
    }
    return true;
}

/* Polynomial of degree `terms` - 1 through the neighbourhood, in s = (t - t0) / scale, by least
 * squares over the n rows that have a reading q_k:
 *     A_ij = sum_k s_k^(i+j) ,   b_i = sum_k s_k^i q_k ,   A c = b .
 * c has TERMS values; those behind `terms` are 0. Returns the rms residual
 *     sqrt(1/n sum_k (q_k - sum_i c_i s_k^i)^2) ,
 * in the joint's unit, the polynomial evaluated by Horner's rule; negative when there are fewer
 * than `terms` readings, or too few different times. */
static double fit(const struct neighbourhood *nb, int terms, double *c)
{
    double a[TERMS][TERMS] = {{0}}, ss = 0.0;
    int n = 0;
    memset(c, 0, sizeof(double) * TERMS);
    for (size_t i = nb->first; i < nb->last; i++) {
        if (isnan(nb->q[i]))
            continue;
        double s = (nb->t[i] - nb->t0) / nb->scale, power[TERMS] = {1.0};
        for (int k = 1; k < terms; k++)
            power[k] = power[k - 1] * s;
        for (int r = 0; r < terms; r++) {
            c[r] += power[r] * nb->q[i];
            for (int k = 0; k <= r; k++)
                a[r][k] += power[r] * power[k];
        }
        n++;
    }
    if (n < terms || !solve_normal(terms, a, c))
        return -1.0;
    for (size_t i = nb->first; i < nb->last; i++) {
        if (isnan(nb->q[i]))
            continue;
        double s = (nb->t[i] - nb->t0) / nb->scale, value = 0.0;
        for (int k = terms - 1; k >= 0; k--)
            value = value * s + c[k];
        ss += (nb->q[i] - value) * (nb->q[i] - value);
    }
    return sqrt(ss / n);
}

/* `half` rows either side of a row, within [first, last). */
static struct neighbourhood around(const struct mk_record *rec, int joint, size_t first,
                                   size_t last, size_t row, size_t half)
{
    struct neighbourhood nb = {rec->t, rec->q[joint], first, last, rec->t[row], 1.0};
    size_t left = row - first < half ? row - first : half;
    size_t right = last - 1 - row < half ? last - 1 - row : half;
    /* One-sided at an end: as many readings as elsewhere. */
    size_t lack_left = half - left, lack_right = half - right;
    right = right + lack_left < last - 1 - row ? right + lack_left : last - 1 - row;
    left = left + lack_right < row - first ? left + lack_right : row - first;
    nb.first = row - left;
    nb.last = row + right + 1;
    double span = fmax(rec->t[nb.last - 1] - nb.t0, nb.t0 - rec->t[nb.first]);
    nb.scale = span > 0.0 ? span : 1.0;
    return nb;
}

/* Angle and speed of one joint at a row: the widest neighbourhood whose residual is still what the
 * encoder's noise explains wins (wider averages more noise, but a polynomial follows the motion
 * only so far). Half widths grow by a quarter, 3, 4, 6, 8, ..., up to `half` or, with 0, half of
 * the rows. The first one that can be fitted counts whatever it leaves; the search ends with the
 * first one that leaves more than 0.45 counts. Where readings are too few for degree 4 the degree
 * falls, to a straight line at least. False when no width can be fitted; *q and *v are then as they
 * were. */
static bool smooth_joint(const struct mk_record *rec, const struct mk_model *model, int joint,
                         size_t first, size_t last, size_t row, int half, double *q, double *v)
{
    double count = mk_model_count(model, joint);
    /* An error that is uniform over one count has a standard deviation of 1 / sqrt(12) = 0.29. */
    double noise = 0.45 * count; /* rounding (0.29) and some jitter, rms */
    bool found = false;
    size_t widest = half > 0 ? (size_t)half : (last - first) / 2 + 1;
    for (size_t h = 3; h <= widest; h += 1 + h / 4) {
        struct neighbourhood nb = around(rec, joint, first, last, row, h);
        double c[TERMS];
        int terms = TERMS;
        double rms = fit(&nb, terms, c);
        while (rms < 0.0 && terms > 2)
            rms = fit(&nb, --terms, c);
        if (rms < 0.0)
            continue;
        if (found && rms > noise)
            break;
        *q = c[0];
        *v = terms > 1 ? c[1] / nb.scale : 0.0;
        found = true;
        if (nb.first == first && nb.last == last)
            break;
    }
    return found;
}

/* Readings y and their slopes v at the row; the true angles q = h^-1(y) (mk_model_unmeasure), with
 * v taken for the speed of the joint: the encoder's effects change it little. States of effects are
 * at rest. x has mk_model_state_count() values, and is written on success only. */
enum mk_status mk_record_state_at(const struct mk_record *rec, const struct mk_model *model,
                                  size_t first, size_t last, size_t row, int half, double *x,
                                  struct mk_error *err)
{
    double y[MK_MAX_JOINTS], v[MK_MAX_JOINTS], q[MK_MAX_JOINTS];
    int n = mk_model_joints(model);
    if (!(first <= row && row < last && last <= rec->rows))
        return mk_error_set(err, MK_ERR_INVALID, "row %zu is outside of the log", row);
    for (int j = 0; j < n; j++)
        if (!smooth_joint(rec, model, j, first, last, row, half, &y[j], &v[j]))
            return mk_error_set(err, MK_ERR_RANGE, "too few readings of q%d around t = %g s", j + 1,
                                rec->t[row]);
    mk_model_unmeasure(model, rec->t[row], y, q);
    mk_model_initial_state(model, q, v, x);
    return MK_OK;
}
