#include "console/commands/plot_data.h"

#include <math.h>
#include <stdlib.h>

#include "base/spectrum.h"
#include "mechkit/sim.h"

#define MOST_POINTS 4000 /* more points than pixels help nobody */

static const char *const angle_names[] = {"q1", "q2"}, *const speed_names[] = {"dq1", "dq2"};

const double *plot_command(const struct mk_log *log, const char **label)
{
    static const char *const names[][3] = {{"u", "u [command units]", "u [command units]"},
                                           {"u1", "u1 [command units]", "u1 [command units]"},
                                           {"tau", "tau [N m]", "tau [N]"},
                                           {"tau1", "tau1 [N m]", "tau1 [N]"}};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        const double *u = mk_log_get(log, names[i][0]);
        if (!u)
            continue;
        if (label)
            *label = names[i][mk_record_joint_slides(log, 0) ? 2 : 1];
        return u;
    }
    return NULL;
}

/* --- logs -------------------------------------------------------------------------------- */

static void put_value(FILE *f, double value)
{
    if (isnan(value))
        fputs(" NaN", f);
    else
        fprintf(f, " %.9g", value);
}

/* Slope of a column over a hundredth of a second around a row. */
static double slope_at(const double *t, const double *q, size_t rows, size_t row)
{
    size_t a = row, b = row;
    while (a > 0 && t[row] - t[a] < 0.005)
        a--;
    while (b + 1 < rows && t[b] - t[row] < 0.005)
        b++;
    return b > a ? (q[b] - q[a]) / (t[b] - t[a]) : (double)NAN;
}

static double speed_at(const struct mk_log *log, int joint, size_t row)
{
    const double *v = mk_log_get(log, speed_names[joint]), *q = mk_log_get(log, angle_names[joint]);
    if (v)
        return v[row];
    return q ? slope_at(mk_log_get(log, "t"), q, log->rows, row) : (double)NAN;
}

void plot_put_log(FILE *f, const char *name, const struct mk_log *log)
{
    const double *t = mk_log_get(log, "t"), *q[2] = {mk_log_get(log, "q1"), mk_log_get(log, "q2")};
    const double *u = plot_command(log, NULL), *ref = mk_log_get(log, "ref");
    const double *window = mk_log_get(log, "window");
    size_t step = log->rows / MOST_POINTS + 1;
    fprintf(f, "%s << EOD\n", name);
    for (size_t r = 0; r < log->rows; r += step) {
        if (window && r >= step && window[r] != window[r - step])
            fputc('\n', f);
        put_value(f, t[r]);
        for (int j = 0; j < 2; j++)
            put_value(f, q[j] ? q[j][r] : (double)NAN);
        put_value(f, u ? u[r] : (double)NAN);
        for (int j = 0; j < 2; j++)
            put_value(f, speed_at(log, j, r));
        put_value(f, ref ? ref[r] : (double)NAN);
        fputc('\n', f);
    }
    fputs("EOD\n", f);
}

/* Value of a column at time `at`, between rows; *row is carried on from call to call. */
static double between(const double *t, const double *y, size_t rows, double at, size_t *row)
{
    while (*row + 1 < rows && t[*row + 1] <= at)
        ++*row;
    if (!y || at < t[0] || at > t[rows - 1] + 1e-9)
        return (double)NAN;
    if (*row + 1 == rows)
        return y[*row];
    double share = (at - t[*row]) / (t[*row + 1] - t[*row]);
    return share < 1e-9 ? y[*row] : y[*row] + share * (y[*row + 1] - y[*row]);
}

void plot_put_difference(FILE *f, const char *name, const struct mk_log *log,
                         const struct mk_log *with)
{
    const double *t = mk_log_get(log, "t"), *then = mk_log_get(with, "t");
    size_t step = log->rows / MOST_POINTS + 1, row[2] = {0, 0};
    fprintf(f, "%s << EOD\n", name);
    for (size_t r = 0; r < log->rows; r += step) {
        put_value(f, t[r]);
        for (int j = 0; j < 2; j++) {
            const double *q = mk_log_get(log, angle_names[j]);
            double model =
                between(then, mk_log_get(with, angle_names[j]), with->rows, t[r], &row[j]);
            put_value(f, q ? model - q[r] : (double)NAN);
        }
        fputc('\n', f);
    }
    fputs("EOD\n", f);
}

/* --- spectra ----------------------------------------------------------------------------- */

/* A column at even spacing; missing readings are bridged. False: there is nothing to bridge from.
 */
static bool resample(const struct mk_log *log, const double *y, double dt, size_t count, bool held,
                     double *out)
{
    const double *t = mk_log_get(log, "t");
    size_t before = 0, after = 0;
    while (before < log->rows && isnan(y[before]))
        before++;
    if (before == log->rows)
        return false;
    after = before;
    for (size_t k = 0; k < count; k++) {
        double at = t[0] + (double)k * dt;
        while (after < log->rows && (t[after] <= at || isnan(y[after]))) {
            if (!isnan(y[after]))
                before = after;
            after++;
        }
        double share = after < log->rows && t[after] > t[before] && !held && at > t[before]
                           ? (at - t[before]) / (t[after] - t[before])
                           : 0.0;
        out[k] = share > 0.0 ? y[before] + share * (y[after] - y[before]) : y[before];
    }
    return true;
}

static void put_spectrum(FILE *f, const char *name, const struct mk_spectrum *s)
{
    double most = 0.0;
    for (size_t k = 0; k < s->count; k++)
        most = fmax(most, s->xx[k]);
    fprintf(f, "%s << EOD\n", name);
    for (size_t k = 0; k < s->count; k++) {
        /* Where there is no command, or it explains next to nothing, gain and phase are noise. */
        bool means = s->coherence[k] > 0.2 && s->xx[k] > 1e-7 * most;
        put_value(f, s->f[k]);
        put_value(f, s->xx[k]);
        put_value(f, s->yy[k]);
        put_value(f, means ? s->gain[k] : (double)NAN);
        put_value(f, means ? remainder(s->phase[k], 2.0 * M_PI) * 180.0 / M_PI : (double)NAN);
        put_value(f, s->coherence[k]);
        fputc('\n', f);
    }
    fputs("EOD\n", f);
}

enum mk_status plot_put_spectrum(FILE *f, const char *name, const struct mk_log *log, int joint,
                                 bool speed, struct mk_error *err)
{
    const double *t = mk_log_get(log, "t"), *u = plot_command(log, NULL);
    const double *q = mk_log_get(log, angle_names[joint]);
    struct mk_spectrum s;
    if (!u || !q || log->rows < 32)
        return mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0,
                           "spectra need a command, %s, and 32 rows at least", angle_names[joint]);
    double dt = (t[log->rows - 1] - t[0]) / (double)(log->rows - 1);
    double *even = calloc(3 * log->rows, sizeof *even);
    if (!even)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for spectra");
    double *in = even, *out = even + log->rows, *column = even + 2 * log->rows;
    for (size_t r = 0; r < log->rows; r++)
        column[r] = speed ? speed_at(log, joint, r) : q[r];
    bool good = resample(log, u, dt, log->rows, true, in) &&
                resample(log, column, dt, log->rows, false, out);
    enum mk_status st =
        good ? mk_spectrum_welch(in, out, log->rows, 1.0 / dt, 0, &s)
             : mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0, "a column of the spectrum is empty");
    if (st == MK_OK) {
        put_spectrum(f, name, &s);
        mk_spectrum_free(&s);
    }
    free(even);
    return st;
}
