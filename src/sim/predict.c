/* Free-run prediction of a log: the model driven by the log's command, against its readings.
 *
 * The log is cut into windows of window_s (0: one window). In each the model runs freely from the
 * best start state x0 that it allows, found by least squares over the window's own readings
 * (sim/start_state.cpp):
 *     dx/dt = f(t, x, u(t)) ,   x(t_first) = x0 ,   e_k = h(t_k, x(t_k)) - y_k ,
 * u held from row to row, y_k the reading of a row and h what the encoder would read. No reading
 * corrects the run on the way, and no window knows of another. Over the rows with a reading,
 *     rms = sqrt(1/n sum e_k^2) ,   nrmse = rms / sd(y) ,
 * sd the standard deviation of the readings about their mean: 1 is no better than a constant.
 *
 * Why windows: an error of the model grows with the length of a run, on an unstable or chaotic rig
 * exponentially. The length says how far ahead the model has to predict.
 *
 * Parameters with a value of their own in every log are found from the first half of the log
 * (sim/own_values.h); figures are then those of the second half, so that nothing is judged on what
 * it was fitted to, but for start states.
 *
 * Two ways to integrate: a solver with error control (whole states, speeds), or the fixed steps of
 * fits, all windows of a batch side by side (angles only). `struct prediction` borrows record,
 * model and the columns of the log that is made; predict() owns the rest.
 */
#include "mechkit/sim.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sim/own_values.h"
#include "sim/predict.h"
#include "sim/start_state.h"

/* What is wanted of the runs. */
enum wanted { ANGLES_AND_SPEEDS, WHOLE_STATES, ANGLES_ONLY };

struct prediction {
    const struct mk_model *model;
    struct mk_record rec;
    struct mk_sim *sim; /* NULL: angles alone, by the steps of fits */
    struct mk_start_finder *finder;
    int joints;
    double *q[MK_MAX_JOINTS], *dq[MK_MAX_JOINTS];
    double *window;           /* NULL when not windowed */
    double *x[MK_MAX_STATES]; /* whole states, NULL when not wanted */
};

/* Command of a row; where it is missing u keeps what it has, which is the command before. */
static void command_at(const struct mk_record *rec, size_t row, double *u)
{
    for (int i = 0; i < MK_MAX_INPUTS; i++)
        if (rec->u[i] && !isnan(rec->u[i][row]))
            u[i] = rec->u[i][row];
}

/* The simulation as it is now, into a row. Angles are as the encoders read them, before rounding;
 * speeds are those of the joints, not of the readings. */
static void store(struct prediction *p, size_t row)
{
    double y[MK_MAX_JOINTS];
    const double *x = mk_sim_state(p->sim);
    mk_sim_measure(p->sim, y);
    for (int j = 0; j < p->joints; j++) {
        p->q[j][row] = y[j];
        p->dq[j][row] = x[p->joints + j];
    }
    for (int i = 0; i < MK_MAX_STATES && p->x[i]; i++)
        p->x[i][row] = x[i];
}

/* The last commands before a row; 0 where there is none. */
static void commands_before(const struct mk_record *rec, size_t row, double *u)
{
    for (int i = 0; i < MK_MAX_INPUTS; i++) {
        u[i] = 0.0;
        for (size_t k = row; rec->u[i] && k-- > 0;)
            if (!isnan(rec->u[i][k])) {
                u[i] = rec->u[i][k];
                break;
            }
    }
}

/* Puts the simulation into state x at a row, the commands of earlier rows that have not come into
 * force yet on their way. With d the command's delay these are the rows with
 *     t_now - d < t_k < t_now ,
 * and what was commanded before them is in force at the start. Times of the simulation count from
 * where the run began (rec->begins), as effects that depend on time do. */
static enum mk_status start_at(struct prediction *p, size_t row, const double *x,
                               struct mk_error *err)
{
    const struct mk_record *rec = &p->rec;
    const double late = mk_model_command_delay(p->model), now = rec->t[row];
    double u[MK_MAX_INPUTS];
    size_t from = row;
    while (from > 0 && rec->t[from - 1] + late > now)
        from--;
    commands_before(rec, from, u);
    enum mk_status st = mk_sim_reset(p->sim, now - rec->begins, x, u);
    if (st == MK_ERR_NUMERIC)
        st =
            mk_error_set(err, st,
                         "the readings around t = %.6g s are of no state to begin a run from: they "
                         "are no numbers, or far too large",
                         now);
    for (size_t k = from; st == MK_OK && k < row; k++) {
        command_at(rec, k, u);
        st = mk_sim_issued_before(p->sim, rec->t[k] - rec->begins, u, err);
    }
    return st;
}

/* Readings that the start state of a run over a whole log is fitted to, s: a prediction of the
 * rest, no fit to it. */
#define FIRST_READINGS_S 1.0

/* The row behind those that the start state of a run over [first, last) is fitted to: all of a
 * window, of a run over a whole log those of its first FIRST_READINGS_S. One row at least. */
static size_t fitted_to(const struct prediction *p, size_t first, size_t last)
{
    const struct mk_record *rec = &p->rec;
    size_t end = last;
    while (!p->window && end > first + 1 && rec->t[end - 1] - rec->t[first] > FIRST_READINGS_S)
        end--;
    return end;
}

/* One window [first, last), from state x. The command of row k acts from t_k to t_(k+1); row k + 1
 * is stored before its own command acts, as a reading is taken. Where the solver fails, the rows
 * from there on keep the NaN that their columns begin with. */
static enum mk_status run_window(struct prediction *p, size_t first, size_t last, const double *x,
                                 struct mk_error *err)
{
    const struct mk_record *rec = &p->rec;
    double u[MK_MAX_INPUTS];
    commands_before(rec, first, u);
    enum mk_status st = start_at(p, first, x, err);
    if (st == MK_OK)
        store(p, first);
    for (size_t k = first; st == MK_OK && k + 1 < last; k++) {
        command_at(rec, k, u);
        st = mk_sim_advance(p->sim, rec->t[k + 1] - rec->begins, u, err);
        if (st == MK_OK)
            store(p, k + 1);
    }
    return st;
}

static bool is_left_out(const struct mk_record *rec, size_t row)
{
    return rec->left_out && rec->left_out[row] != 0.0;
}

static size_t skip_left_out(const struct mk_record *rec, size_t row)
{
    while (row < rec->rows && is_left_out(rec, row))
        row++;
    return row;
}

/* The window that begins at a row. Windows lie on a grid from the first row of the log, W =
 * window_s:
 *     number = floor((t_first - t_0) / W) ,   end at t_0 + (number + 1) W ,
 * so that one that begins behind left-out rows is shorter, and figures of two models are of the
 * same windows. 1e-9 W keeps rounding of the times from moving a row across an end. The number goes
 * into the column `window` of its rows. Left-out rows end a window. */
static struct mk_row_range window_at(const struct prediction *p, size_t first, double window_s)
{
    const struct mk_record *rec = &p->rec;
    double end = HUGE_VAL, index = 0.0;
    if (window_s > 0.0) {
        index = floor((rec->t[first] - rec->t[0]) / window_s + 1e-9);
        end = rec->t[0] + (index + 1.0) * window_s - 1e-9 * window_s;
    }
    size_t last = first + 1;
    while (last < rec->rows && rec->t[last] < end && !is_left_out(rec, last))
        last++;
    for (size_t k = first; p->window && k < last; k++)
        p->window[k] = index;
    return (struct mk_row_range){first, last};
}

/* Windows whose start states are found together. */
#define TOGETHER 64

/* Runs over these windows, `count` <= TOGETHER of them: first all start states x (a row of
 * MK_MAX_STATES for each window), then the runs. A window fails where its start state cannot be
 * found or its run ends early; the others go on. Returns how many failed; *last is the status of
 * the last window, and with it a reason where all have failed. */
static size_t run_together(struct prediction *p, const struct mk_row_range *window, size_t count,
                           enum mk_status *last, struct mk_error *err)
{
    double x[TOGETHER][MK_MAX_STATES];
    enum mk_status status[TOGETHER];
    struct mk_row_range fitted[TOGETHER];
    size_t failed = 0;
    for (size_t i = 0; i < count; i++)
        fitted[i] =
            (struct mk_row_range){window[i].first, fitted_to(p, window[i].first, window[i].last)};
    enum mk_status found = mk_start_states(p->finder, fitted, count, x[0], status, err);
    if (found == MK_OK && !p->sim)
        found = mk_free_angles(p->finder, window, count, x[0], status, p->q, err);
    for (size_t i = 0; i < count; i++) {
        enum mk_status st = found == MK_OK ? status[i] : found;
        for (int j = 0; st == MK_OK && !p->sim && j < p->joints; j++)
            p->dq[j][window[i].first] = x[i][p->joints + j];
        if (st == MK_OK && p->sim)
            st = run_window(p, window[i].first, window[i].last, x[i], err);
        failed += st != MK_OK;
        *last = st;
    }
    return failed;
}

/* All windows of the log, by batches. An error only where every one of them has failed, or where
 * no row is left: a model that runs away in some windows is judged by the others. */
static enum mk_status run_windows(struct prediction *p, double window_s, size_t *windows,
                                  size_t *failed, struct mk_error *err)
{
    const struct mk_record *rec = &p->rec;
    struct mk_row_range window[TOGETHER];
    enum mk_status st = MK_OK;
    *windows = *failed = 0;
    size_t first = skip_left_out(rec, 0);
    while (first < rec->rows) {
        size_t count = 0;
        while (first < rec->rows && count < TOGETHER) {
            window[count] = window_at(p, first, window_s);
            first = skip_left_out(rec, window[count++].last);
        }
        *failed += run_together(p, window, count, &st, err);
        *windows += count;
    }
    if (*windows == 0)
        return mk_error_set(err, MK_ERR_RANGE,
                            "all rows are left out: there is nothing to predict");
    return *failed == *windows ? st : MK_OK;
}

/* First row of the log's second half. */
static size_t middle(const struct mk_record *rec)
{
    const double half = 0.5 * (rec->t[0] + rec->t[rec->rows - 1]);
    size_t row = 0;
    while (row + 1 < rec->rows && rec->t[row] < half)
        row++;
    return row;
}

/* First row of the first window that begins there; without windows that row. A window that reaches
 * into the first half has readings by which own values were found. Where the last window does, the
 * middle row all the same. */
static size_t first_judged(const struct prediction *p)
{
    size_t row = middle(&p->rec);
    while (p->window && row > 0 && row < p->rec.rows && p->window[row] == p->window[row - 1])
        row++;
    return row < p->rec.rows ? row : middle(&p->rec);
}

/* The figures of rows from `from` on, joint by joint. With m the mean of the n readings y_k, and
 * n_c rows that have a prediction h_k as well,
 *     rms = sqrt(sum (h_k - y_k)^2 / n_c) ,   nrmse = rms / sqrt(sum (y_k - m)^2 / n) ;
 * the sum of squares about m is taken in a second pass, so that nothing cancels. NaN where nothing
 * is compared, and nrmse where the joint stands still. */
static void compare(const struct prediction *p, size_t from, struct mk_predict_figures *out)
{
    const struct mk_record *rec = &p->rec;
    out->from_s = rec->t[from] - rec->t[0];
    for (int j = 0; j < p->joints; j++) {
        double sum = 0.0, squares = 0.0, error = 0.0;
        size_t n = 0, compared = 0;
        for (size_t k = from; k < rec->rows; k++) {
            double y = rec->q[j][k];
            if (isnan(y))
                continue;
            sum += y;
            n++;
            if (isnan(p->q[j][k]))
                continue;
            error += (p->q[j][k] - y) * (p->q[j][k] - y);
            compared++;
        }
        double mean = n ? sum / (double)n : 0.0;
        for (size_t k = from; k < rec->rows; k++)
            if (!isnan(rec->q[j][k]))
                squares += (rec->q[j][k] - mean) * (rec->q[j][k] - mean);
        out->rms[j] = compared ? sqrt(error / (double)compared) : (double)NAN;
        out->nrmse[j] = squares > 0.0 ? out->rms[j] / sqrt(squares / (double)n) : (double)NAN;
        if (j == 0)
            out->rows = compared;
    }
}

static enum mk_status add_columns(struct prediction *p, struct mk_log *log, bool windowed,
                                  enum wanted wanted)
{
    double *t = mk_log_add_column(log, "t");
    if (!t)
        return MK_ERR_NOMEM;
    memcpy(t, p->rec.t, sizeof(double) * p->rec.rows);
    /* Data pointers stay valid while columns are added: each column has memory of its own. */
    for (int j = 0; j < p->joints; j++)
        if (!(p->q[j] = mk_log_add_column(log, mk_log_angle(j))))
            return MK_ERR_NOMEM;
    for (int j = 0; j < p->joints; j++)
        if (!(p->dq[j] = mk_log_add_column(log, mk_log_speed(j))))
            return MK_ERR_NOMEM;
    if (windowed && !(p->window = mk_log_add_column(log, "window")))
        return MK_ERR_NOMEM;
    for (int i = 0; wanted == WHOLE_STATES && i < mk_model_state_count(p->model); i++) {
        char name[16];
        snprintf(name, sizeof name, "x%d", i + 1);
        if (!(p->x[i] = mk_log_add_column(log, name)))
            return MK_ERR_NOMEM;
    }
    return mk_log_set_meta(log, "rig", mk_plant(p->model->plant)->name);
}

/* Below this rounding is seen, and steps would be shortened for it. */
#define FINEST_RTOL 1e-12
#define FINEST_ATOL 1e-14

/* Without contact the model's own. With it a thousandth, but no less than FINEST and no more than
 * the model's: every impact multiplies the errors that were made before it. */
void mk_free_run_tolerances(const struct mk_model *model, double *rtol, double *atol)
{
    bool contact = mk_model_event_count(model) > 0;
    *rtol = contact ? fmin(model->rtol, fmax(1e-3 * model->rtol, FINEST_RTOL)) : model->rtol;
    *atol = contact ? fmin(model->atol, fmax(1e-3 * model->atol, FINEST_ATOL)) : model->atol;
}

/* Of the free runs that own values are found by: as long as those that are asked for, but no longer
 * than a model of a real rig is good for. */
static double own_window(double window_s)
{
    const double usual = 0.5, longest = 2.0; /* s */
    return window_s > 0.0 ? fmin(window_s, longest) : usual;
}

/* The integration as it was asked for; what was left open as a free run of the model needs it. */
static struct mk_sim_config config_of(const struct mk_predict_options *options,
                                      const struct mk_model *model)
{
    struct mk_sim_config config = options ? options->sim : (struct mk_sim_config){0};
    double rtol, atol;
    mk_free_run_tolerances(model, &rtol, &atol);
    config.rtol = config.rtol > 0.0 ? config.rtol : rtol;
    config.atol = config.atol > 0.0 ? config.atol : atol;
    return config;
}

/* Reads the log, and finds the values that the model has of its own in it; `own` is the model with
 * them. */
static enum mk_status read_log(struct prediction *p, const struct mk_log *log, double window_s,
                               struct mk_model *own, struct mk_predict_figures *figures,
                               struct mk_error *err)
{
    enum mk_status st = mk_record_from_log(log, p->model, &p->rec, err);
    if (st == MK_OK && p->rec.rows < 2)
        st = mk_error_at(err, MK_ERR_PARSE, log->path, 0, 0, "a prediction needs at least 2 rows");
    if (st != MK_OK || !mk_model_has_own_values(p->model))
        return st;
    st = mk_find_own_values(&p->rec, p->model, middle(&p->rec), own_window(window_s), own,
                            figures->own, &figures->own_count, err);
    p->model = own;
    return st;
}

/* All of it in order: record and own values, the log to fill, simulation and start states, runs,
 * figures. `figures` and `failed` may be NULL, and are written on success only. On failure *out is
 * NULL; on success it is the caller's. */
static enum mk_status predict(const struct mk_model *model, const struct mk_log *log,
                              const struct mk_predict_options *options, enum wanted wanted,
                              struct mk_log **out, struct mk_predict_figures *figures,
                              size_t *failed, struct mk_error *err)
{
    struct mk_model own;
    const double window_s = options ? options->window_s : 0.0;
    const struct mk_sim_config config = config_of(options, model);
    struct prediction p = {.model = model, .joints = mk_model_joints(model)};
    struct mk_predict_figures figs;
    struct mk_log *made = NULL;
    size_t bad = 0;
    memset(&figs, 0, sizeof figs);
    *out = NULL;
    enum mk_status st = read_log(&p, log, window_s, &own, &figs, err);
    if (st == MK_OK)
        st = mk_log_create(p.rec.rows, &made);
    if (st == MK_OK)
        st = add_columns(&p, made, window_s > 0.0, wanted);
    if (st == MK_OK && wanted != ANGLES_ONLY)
        st = mk_sim_create(p.model, &config, &p.sim, err);
    if (st == MK_OK && !(p.finder = mk_start_finder_create(&p.rec, p.model)))
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for the start states");
    if (st == MK_OK)
        st = run_windows(&p, window_s, &figs.windows, &bad, err);
    if (st == MK_OK) {
        const bool half = p.model != model || (options && options->second_half);
        compare(&p, half ? first_judged(&p) : 0, &figs);
        *out = made;
        made = NULL;
        if (figures)
            *figures = figs;
        if (failed)
            *failed = bad;
    }
    mk_sim_destroy(p.sim);
    mk_start_finder_destroy(p.finder);
    mk_log_free(made);
    return st;
}

enum mk_status mk_predict(const struct mk_model *model, const struct mk_log *log,
                          const struct mk_predict_options *options, struct mk_log **out,
                          struct mk_predict_figures *figures, size_t *failed, struct mk_error *err)
{
    return predict(model, log, options, ANGLES_AND_SPEEDS, out, figures, failed, err);
}

enum mk_status mk_predict_states(const struct mk_model *model, const struct mk_log *log,
                                 const struct mk_predict_options *options, struct mk_log **out,
                                 struct mk_predict_figures *figures, size_t *failed,
                                 struct mk_error *err)
{
    return predict(model, log, options, WHOLE_STATES, out, figures, failed, err);
}

enum mk_status mk_predict_angles(const struct mk_model *model, const struct mk_log *log,
                                 const struct mk_predict_options *options, struct mk_log **out,
                                 struct mk_predict_figures *figures, size_t *failed,
                                 struct mk_error *err)
{
    return predict(model, log, options, ANGLES_ONLY, out, figures, failed, err);
}
