#include "console/log_doubts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/exchange.h"
#include "mechkit/number.h"
#include "mechkit/sim.h"

#define TURN 6.283185307179586

static const char *const angles[MK_MAX_JOINTS] = {"q1", "q2"};

enum mk_status log_read_all(const char *const *paths, size_t count, struct mk_log **logs,
                            struct mk_error *err)
{
    enum mk_status st = MK_OK;
    for (size_t i = 0; i < count && st == MK_OK; i++) {
        st = mk_log_read(paths[i], &logs[i], err);
        if (st == MK_OK && logs[i]->truncated)
            fprintf(stderr, "mechkit: %s: the last line is incomplete and was left out\n",
                    paths[i]);
    }
    return st;
}

/* --- certain ---------------------------------------------------------------------------------- */

static void range_of(const double *q, size_t rows, double *low, double *high)
{
    *low = HUGE_VAL;
    *high = -HUGE_VAL;
    for (size_t k = 0; k < rows; k++)
        if (!isnan(q[k])) {
            *low = fmin(*low, q[k]);
            *high = fmax(*high, q[k]);
        }
}

/* The row whose reading is a whole turn from where the readings before and after it point; 0: there
 * is none. What was wrapped stays within one turn, which sets it apart from pulses that were lost.
 */
static size_t wrapped_at(const double *q, size_t rows, double turn)
{
    double low, high;
    range_of(q, rows, &low, &high);
    if (!(high - low > 0.9 * turn && high - low < 1.001 * turn))
        return 0;
    for (size_t k = 2; k + 1 < rows; k++) {
        double step = q[k] - q[k - 1], rest = remainder(step, turn);
        double before = remainder(q[k - 1] - q[k - 2], turn);
        double after = remainder(q[k + 1] - q[k], turn);
        if (fabs(step) > 0.9 * turn && fabs(rest - 0.5 * (before + after)) < 0.05 * turn &&
            fabs(before - after) < 0.1 * turn)
            return k;
    }
    return 0;
}

static enum mk_status check_wrapping(const struct mk_log *log, const struct mk_record *r, int joint,
                                     struct mk_error *err)
{
    const double turns[] = {TURN, 360.0};
    for (size_t i = 0; i < 2; i++) {
        size_t row = wrapped_at(r->q[joint], r->rows, turns[i]);
        if (row > 0)
            return mk_error_at(
                err, MK_ERR_EXPECT, log->path, log->first_row_line + (int)row, 0,
                "%s jumps from %.6g to %.6g: it is wrapped to one turn%s; unwrap it "
                "first, so that turns are counted on (numpy.unwrap, MATLAB's unwrap)",
                angles[joint], r->q[joint][row - 1], r->q[joint][row], i ? ", and in degrees" : "");
    }
    return MK_OK;
}

/* Whether the readings step by `size` and whole multiples of it. */
static bool steps_by(const double *q, size_t rows, double size)
{
    size_t steps = 0, multiples = 0;
    for (size_t k = 1; k < rows; k++) {
        double step = fabs(q[k] - q[k - 1]) / size;
        if (!(step > 1e-6))
            continue;
        steps++;
        multiples += step > 0.5 && step < 1e6 && fabs(step - round(step)) < 0.05;
    }
    return steps >= 50 && multiples * 100 >= steps * 98;
}

/* Counts per turn of a joint, after the log itself or, where it says nothing sensible, the model.
 */
static double counts_of(const struct mk_log *log, const struct mk_model *model, int joint)
{
    const char *text = mk_log_find_meta(log, "encoder_cpr");
    for (int j = 0; text && *text; j++) {
        char *end;
        double value = strtod(text, &end);
        if (end == text || !(value >= 1.0 && value <= 1e8))
            break;
        if (j == joint)
            return value;
        text = end + strspn(end, " \t,");
    }
    return model->encoder_cpr[joint];
}

/* Steps of an encoder in another unit than rad are 57 times or hundreds of times as large as they
 * should be: no encoder, and no error of its scale, is off by so much. */
static enum mk_status check_units(const struct mk_log *log, const struct mk_model *model,
                                  const struct mk_record *r, struct mk_error *err)
{
    char which[16] = "", change[80] = "";
    bool degrees = false;
    double cpr = 0.0;
    for (int j = 0; j < mk_model_joints(model); j++) {
        const double counts = counts_of(log, model, j);
        const bool in_degrees = steps_by(r->q[j], r->rows, 360.0 / counts);
        if (!in_degrees && (counts < 100.0 || !steps_by(r->q[j], r->rows, 1.0)))
            continue;
        if (which[0] && in_degrees != degrees)
            continue;
        degrees = in_degrees;
        cpr = counts;
        snprintf(which + strlen(which), sizeof which - strlen(which), "%s%s",
                 which[0] ? " and " : "", angles[j]);
        size_t used = strlen(change);
        if (degrees)
            snprintf(change + used, sizeof change - used, "%s[%s] unit = deg", used ? ", " : "",
                     angles[j]);
        else
            snprintf(change + used, sizeof change - used, "%s[%s] sign = %.10g", used ? ", " : "",
                     angles[j], TURN / counts);
    }
    if (!which[0])
        return MK_OK;
    return mk_error_at(err, MK_ERR_EXPECT, log->path, 0, 0,
                       "%s: steps of %g are those of %g counts a turn in %s, but angles are in "
                       "rad: mechkit import --map with %s converts them",
                       which, degrees ? 360.0 / cpr : 1.0, cpr, degrees ? "degrees" : "raw counts",
                       change);
}

/* --- likely ----------------------------------------------------------------------------------- */

#define WINDOW_S 0.2
#define MOST_ROWS 5000 /* that are looked at */
#define MOST_S 20.0
#define HOPELESS 4.0

/* Squared error of predictions over that of speeds that stay as they are, mean over the joints
 * whose speeds do not: below 1 the model knows something of these data. 0: nothing moves, or
 * nothing can be said. */
static double misfit(const struct mk_model *model, const struct mk_log *log)
{
    static const char *const speeds[MK_MAX_JOINTS] = {"dq1", "dq2"};
    const struct mk_predict_options o = {.window_s = WINDOW_S};
    struct mk_predict_figures figures;
    struct mk_log *made = NULL;
    double sum = 0.0, n = 0.0;
    if (mk_predict(model, log, &o, &made, &figures, NULL, NULL) != MK_OK)
        return 0.0;
    const double *t = mk_log_get(log, "t"), *window = mk_log_get(made, "window");
    for (int j = 0; j < mk_model_joints(model) && window; j++) {
        const double *y = mk_log_get(log, angles[j]), *q = mk_log_get(made, angles[j]);
        const double *v = mk_log_get(made, speeds[j]), noise = 3.0 * TURN / model->encoder_cpr[j];
        double off = 0.0, even = 0.0, count = 0.0;
        for (size_t k = 0, first = 0; k < log->rows; k++) {
            if (window[k] != window[first])
                first = k;
            double stay = y[k] - (q[first] + v[first] * (t[k] - t[first]));
            if (!isfinite(stay))
                continue;
            off += isfinite(q[k]) ? (y[k] - q[k]) * (y[k] - q[k]) : HOPELESS * stay * stay;
            even += stay * stay;
            count++;
        }
        if (even > noise * noise * count) {
            sum += fmin(off / even, HOPELESS);
            n++;
        }
    }
    mk_log_free(made);
    return n > 0.0 ? sum / n : 0.0;
}

/* The log's own columns as a mapping for `import` calls them. */
static void map_itself(const struct mk_log *log, const struct mk_model *model,
                       struct mk_import_map *map)
{
    static const char *const names[] = {"t", "q1", "q2", "u", "tau", "u1", "u2", "tau1", "tau2"};
    *map = (struct mk_import_map){.rig = mk_plant(model->plant)->kind, .no_input = true};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        if (!mk_log_get(log, names[i]) || (i == 2 && mk_model_joints(model) < 2))
            continue;
        map->no_input = map->no_input && i < 3; /* t, q1, q2; the rest are commands */
        struct mk_import_column *c = &map->column[map->count++];
        *c = (struct mk_import_column){.sign = 1.0};
        snprintf(c->to, sizeof c->to, "%s", names[i]);
        snprintf(c->from, sizeof c->from, "%s", names[i]);
    }
}

struct case_of {
    const struct mk_model *model;
    const struct mk_log *log;
    struct mk_table *table;
    struct mk_import_map map;
    double now; /* misfit of the data as they are */
};

static double misfit_of(const struct case_of *c, const struct mk_import_map *map)
{
    struct mk_log *log = NULL;
    double out = HUGE_VAL;
    if (mk_import_apply(c->table, c->log->path, map, &log, NULL) == MK_OK)
        out = misfit(c->model, log);
    mk_log_free(log);
    return out;
}

/* What `import` finds goes by the textbook, and any rig of the kind. The model is of this one: it
 * has to agree. */
static int say_what_import_finds(const struct case_of *c)
{
    struct mk_import_finding findings[MK_IMPORT_FINDINGS];
    int said = 0, count = mk_import_check(c->table, c->log->path, &c->map, findings);
    for (int i = 0; i < count; i++) {
        const struct mk_import_finding *f = &findings[i];
        if (f->proposal[0] && !(misfit_of(c, &f->fixed) < 0.5 * c->now))
            continue;
        fprintf(stderr, "mechkit: %s: implausible: %s%s%s\n", c->log->path, f->what,
                f->proposal[0] ? "; if so, mechkit import --map with " : "", f->proposal);
        said++;
    }
    return said;
}

static void flip(struct mk_import_map *map, const char *name)
{
    struct mk_import_column *column = mk_import_map_find(map, name);
    if (column)
        column->sign = -column->sign;
}

/* Where the textbook finds nothing: signs and places of columns under which a model predicts that
 * knows nothing of the data as they are. */
static void say_what_the_model_knows(const struct case_of *c)
{
    static const struct {
        bool u, q1, q2, swap;
        const char *what, *mend;
    } changes[] = {
        {true, false, false, false, "the command pushes the wrong way", "[u] sign = -1"},
        {false, true, false, false, "q1 counts the wrong way", "[q1] sign = -1"},
        {false, false, true, false, "q2 counts the wrong way", "[q2] sign = -1"},
        {false, true, true, false, "both angles count the wrong way",
         "[q1] sign = -1, [q2] sign = -1"},
        {false, false, false, true, "the joints are swapped", "[q1] column = q2, [q2] column = q1"},
    };
    const double know_nothing = 0.7, know = 0.35;
    const char *what = NULL, *mend = NULL;
    double least = know;
    for (size_t i = 0; c->now > know_nothing && i < sizeof changes / sizeof changes[0]; i++) {
        struct mk_import_map map = c->map;
        struct mk_import_column *q1 = mk_import_map_find(&map, "q1");
        struct mk_import_column *q2 = mk_import_map_find(&map, "q2");
        if (!q2 && (changes[i].q2 || changes[i].swap))
            continue;
        for (int k = 0; changes[i].u && k < 4; k++)
            flip(&map, (const char *const[]){"u", "tau", "u1", "tau1"}[k]);
        if (changes[i].q1)
            flip(&map, "q1");
        if (changes[i].q2)
            flip(&map, "q2");
        if (changes[i].swap) {
            strcpy(q1->from, "q2");
            strcpy(q2->from, "q1");
        }
        double then = misfit_of(c, &map);
        if (then < least) {
            least = then;
            what = changes[i].what;
            mend = changes[i].mend;
        }
    }
    if (what)
        fprintf(stderr,
                "mechkit: %s: implausible: the model knows nothing of these data as they are, but "
                "would if %s; if so, mechkit import --map with %s\n",
                c->log->path, what, mend);
}

static void say_what_is_likely(const struct mk_log *log, const struct mk_model *model)
{
    struct mk_log beginning = *log;
    const double *t = mk_log_get(log, "t");
    struct case_of c = {.model = model, .log = log};
    if (beginning.rows > MOST_ROWS)
        beginning.rows = MOST_ROWS;
    while (beginning.rows > 2 && t[beginning.rows - 1] - t[0] > MOST_S)
        beginning.rows--;
    if (mk_table_from_log(&beginning, NULL, 0.0, &c.table, NULL) != MK_OK)
        return;
    map_itself(log, model, &c.map);
    c.now = misfit_of(&c, &c.map);
    if (say_what_import_finds(&c) == 0)
        say_what_the_model_knows(&c);
    mk_table_free(c.table);
}

static void compare_torque(const struct mk_log *log, const struct mk_model *model,
                           const struct mk_record *r)
{
    const char *text = mk_log_find_meta(log, "u_to_torque");
    double value = 0.0;
    if (!text || r->si)
        return;
    if (!mk_parse_double_z(text, &value) || !(value > 0.0))
        fprintf(stderr,
                "mechkit: %s: u_to_torque: '%.40s' is no number above 0; the model's %g is taken\n",
                log->path, text, model->u_to_torque);
    else if (fabs(value / model->u_to_torque - 1.0) > 1e-3)
        fprintf(stderr,
                "mechkit: %s: u_to_torque is %g here, %g in the model, which is taken: torques in "
                "N m differ by as much\n",
                log->path, value, model->u_to_torque);
}

static void compare_counts(const struct mk_log *log, const struct mk_model *model)
{
    for (int j = 0; j < mk_model_joints(model); j++) {
        double counts = counts_of(log, model, j);
        if (fabs(counts - model->encoder_cpr[j]) > 0.5)
            fprintf(stderr,
                    "mechkit: %s: encoder_cpr of joint %d is %g here, %d in the model, which is "
                    "taken\n",
                    log->path, j + 1, counts, model->encoder_cpr[j]);
    }
}

static int by_size(const void *a, const void *b)
{
    const double *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

static void compare_rate(const struct mk_log *log, const struct mk_record *r)
{
    enum { STEPS = 1000 };
    double step[STEPS], rate = 0.0;
    const char *text = mk_log_find_meta(log, "sample_rate_hz");
    size_t count = 0, stride = r->rows / STEPS + 1;
    if (!text || r->rows < 3)
        return;
    for (size_t k = 1; k < r->rows && count < STEPS; k += stride)
        step[count++] = r->t[k] - r->t[k - 1];
    qsort(step, count, sizeof step[0], by_size);
    double period = step[count / 2];
    if (!mk_parse_double_z(text, &rate) || !(rate > 0.0))
        fprintf(stderr, "mechkit: %s: sample_rate_hz: '%.40s' is no number above 0\n", log->path,
                text);
    else if (fabs(rate * period - 1.0) > 0.05)
        fprintf(stderr,
                "mechkit: %s: sample_rate_hz is %g, but the rows are %.4g s apart (%.4g Hz): the "
                "times are taken\n",
                log->path, rate, period, 1.0 / period);
}

/* --- what is there ------------------------------------------------------------------------------
 */

#define MANY 0.1 /* of the rows */

static double missing_share(const double *x, size_t rows)
{
    size_t missing = 0;
    for (size_t k = 0; k < rows; k++)
        missing += isnan(x[k]);
    return (double)missing / (double)rows;
}

static void say_what_is_missing(const struct mk_log *log, const struct mk_model *model,
                                const struct mk_record *r)
{
    for (int j = 0; j < mk_model_joints(model); j++) {
        double share = missing_share(r->q[j], r->rows);
        if (share > MANY && share < 1.0)
            fprintf(stderr, "mechkit: %s: %.0f %% of the readings of %s are missing\n", log->path,
                    100.0 * share, angles[j]);
    }
    double share = r->u[0] ? missing_share(r->u[0], r->rows) : 0.0;
    if (share > MANY && share < 1.0)
        fprintf(stderr,
                "mechkit: %s: %.0f %% of the commands are missing, and made up from those before "
                "and after\n",
                log->path, 100.0 * share);
}

/* A command may overshoot where it is clipped for real; by so much, or so often, it is another unit
 * or garbage. */
static void say_what_is_clipped(const struct mk_log *log, const struct mk_model *model,
                                const struct mk_record *r)
{
    size_t beyond = 0, far = 0;
    double most = 0.0;
    for (size_t k = 0; r->u[0] && k < r->rows; k++) {
        double u = fabs(r->u[0][k]);
        beyond += u > model->u_max * (1.0 + 1e-9);
        far += u > 10.0 * model->u_max;
        most = fmax(most, u);
    }
    if (far > 0 || (double)beyond > 0.01 * (double)r->rows)
        fprintf(stderr,
                "mechkit: %s: the command reaches %.3g and is beyond the model's u_max = %g in %zu "
                "of %zu rows, where it is taken as clipped: are the units right?\n",
                log->path, most, model->u_max, beyond, r->rows);
}

void log_extremes(const struct mk_log *log, const struct mk_model *model)
{
    const double most = 1e6; /* rad; as `import` has it */
    struct mk_record r;
    if (mk_record_from_log(log, model, &r, NULL) != MK_OK)
        return;
    say_what_is_clipped(log, model, &r);
    for (int j = 0; j < mk_model_joints(model); j++) {
        double low, high;
        range_of(r.q[j], r.rows, &low, &high);
        if (low < -most || high > most)
            fprintf(stderr,
                    "mechkit: %s: implausible: %s reaches %.3g rad: that is no angle of a rig\n",
                    log->path, angles[j], fmax(-low, high));
    }
}

/* --- the whole -------------------------------------------------------------------------------- */

enum mk_status log_doubts(const struct mk_log *const *logs, size_t count,
                          const struct mk_model *model, struct mk_error *err)
{
    enum mk_status st = MK_OK;
    for (size_t i = 0; i < count && st == MK_OK; i++) {
        struct mk_record r;
        if (mk_record_from_log(logs[i], model, &r, NULL) != MK_OK)
            continue;
        for (int j = 0; j < mk_model_joints(model) && st == MK_OK; j++)
            st = check_wrapping(logs[i], &r, j, err);
        if (st == MK_OK)
            st = check_units(logs[i], model, &r, err);
        if (st != MK_OK)
            return st;
        compare_torque(logs[i], model, &r);
        compare_counts(logs[i], model);
        compare_rate(logs[i], &r);
        say_what_is_missing(logs[i], model, &r);
        say_what_is_clipped(logs[i], model, &r);
        say_what_is_likely(logs[i], model);
    }
    return st;
}
