/* Prediction of logs: columns under their names, start states, windows, figures; measured logs of
 * real rigs when they are there. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mechkit/exchange.h"
#include "mechkit/ident.h"
#include "mechkit/sim.h"
#include "sim/predict.h"
#include "support/files.h"
#include "support/program.h"

/* A log of the model itself, sampled at 500 Hz and rounded to counts (0: exact). */
static struct mk_log *record_from(const struct mk_model *m, const double *q0, double count,
                                  double seconds)
{
    struct mk_log *log;
    struct mk_sim *sim;
    size_t rows = (size_t)(seconds * 500) + 1;
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *t = mk_log_add_column(log, "t"), *q[2], *u = mk_log_add_column(log, "u");
    q[0] = mk_log_add_column(log, "q1");
    q[1] = mk_log_add_column(log, "q2");
    double v[2] = {0.5, -0.3}, x[MK_MAX_STATES], y[2];
    ck_assert_int_eq(mk_sim_create(m, NULL, &sim, NULL), MK_OK);
    mk_model_initial_state(m, q0, v, x);
    ck_assert_int_eq(mk_sim_reset(sim, 0, x, NULL), MK_OK);
    for (size_t k = 0; k < rows; k++) {
        double command[2] = {1.5 * sin(6 * 0.002 * (double)k), 0};
        mk_sim_measure(sim, y);
        t[k] = 0.002 * (double)k;
        u[k] = command[0];
        for (int j = 0; j < 2; j++)
            q[j][k] = count > 0 ? round(y[j] / count) * count : y[j];
        ck_assert_int_eq(mk_sim_advance(sim, 0.002 * (double)(k + 1), command, NULL), MK_OK);
    }
    mk_sim_destroy(sim);
    return log;
}

static struct mk_log *record(const struct mk_model *m, double count, double seconds)
{
    return record_from(m, mk_plant(m->plant)->rest, count, seconds);
}

static struct mk_log *predict(const struct mk_model *m, const struct mk_log *log, double window,
                              struct mk_predict_figures *f)
{
    struct mk_log *out;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_predict_options o = {.window_s = window};
    size_t failed;
    ck_assert_msg(mk_predict(m, log, &o, &out, f, &failed, &err) == MK_OK, "%s", err.message);
    ck_assert_uint_eq(failed, 0);
    return out;
}

static struct mk_predict_figures figures_of(const struct mk_model *m, const struct mk_log *log,
                                            double window)
{
    struct mk_predict_figures f;
    mk_log_free(predict(m, log, window, &f));
    return f;
}

static void add_effect(struct mk_model *m, const char *name, int joint, double value)
{
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_model_add_effect(m, name, joint, &err) == MK_OK, "%s", err.message);
    m->effect[m->effect_count - 1].value[0] = value;
}

START_TEST(a_model_predicts_its_own_log)
{
    struct mk_model m;
    struct mk_predict_figures f;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    struct mk_log *log = record(&m, 0, 5), *out = predict(&m, log, 0, &f);
    /* The start state comes from the readings: good to a part of a count. */
    ck_assert_double_lt(f.nrmse[0], 4e-3);
    ck_assert_double_lt(f.nrmse[1], 4e-2);
    ck_assert_uint_eq(out->rows, log->rows);
    ck_assert_ptr_null(mk_log_get(out, "window"));
    mk_log_free(out);
    mk_log_free(log);
    /* Through an encoder: the start state is as good as the counts allow. */
    log = record(&m, 2 * M_PI / 4000, 5);
    out = predict(&m, log, 1.0, &f);
    ck_assert_double_lt(f.rms[0], 0.01);
    ck_assert_double_lt(f.rms[1], 0.02);
    ck_assert_uint_eq(f.windows, 6); /* the last row opens one */
    const double *w = mk_log_get(out, "window");
    ck_assert(w[0] == 0 && w[499] == 0 && w[500] == 1 && w[2499] == 4);
    mk_log_free(out);
    mk_log_free(log);
}
END_TEST

START_TEST(a_wrong_model_shows_in_the_figures)
{
    struct mk_model m, wrong;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    wrong = m;
    wrong.parameter[3] *= 1.2;
    struct mk_log *log = record(&m, 2 * M_PI / 4000, 5);
    double right = figures_of(&m, log, 0).nrmse[0], off = figures_of(&wrong, log, 0).nrmse[0];
    ck_assert_double_gt(off, 10 * right);
    mk_log_free(log);
}
END_TEST

/* Squared error of a free run over rows [first, last), from a state that is off by `by` in one of
 * its coordinates. */
static double squares_from(const struct mk_model *m, const struct mk_log *log,
                           const struct mk_log *prediction, size_t first, size_t last, int which,
                           double by)
{
    static const char *const column[] = {"q1", "q2", "dq1", "dq2"};
    const double *t = mk_log_get(log, "t"), *u = mk_log_get(log, "u");
    double x[MK_MAX_STATES], y[2], sum = 0;
    struct mk_sim *sim;
    for (int i = 0; i < 4; i++)
        x[i] = mk_log_get(prediction, column[i])[first] + (i == which ? by : 0);
    ck_assert_int_eq(mk_sim_create(m, NULL, &sim, NULL), MK_OK);
    double before[2] = {first > 0 ? u[first - 1] : 0, 0};
    ck_assert_int_eq(mk_sim_reset(sim, t[first], x, before), MK_OK);
    for (size_t k = first; k < last; k++) {
        double command[2] = {u[k], 0};
        mk_sim_measure(sim, y);
        for (int j = 0; j < 2; j++)
            sum += pow(mk_log_get(log, column[j])[k] - y[j], 2);
        if (k + 1 < last)
            ck_assert_int_eq(mk_sim_advance(sim, t[k + 1], command, NULL), MK_OK);
    }
    mk_sim_destroy(sim);
    return sum;
}

/* No state near it does better, although the model is wrong by far more than the readings' noise:
 * what is left is the model's error and no start state's. */
START_TEST(a_window_starts_where_a_wrong_model_meets_its_readings_best)
{
    struct mk_model m, wrong;
    struct mk_predict_figures f;
    const bool falls = _i == 1; /* from where it is unstable, besides */
    const double top[2] = {0.0, 0.01};
    mk_model_default(falls ? MK_PLANT_FURUTA : MK_PLANT_PENDUBOT, &m);
    const double *from = falls ? top : mk_plant(m.plant)->rest;
    wrong = m;
    wrong.parameter[3] *= 1.3;
    wrong.parameter[0] *= 0.8;
    struct mk_log *log = record_from(&m, from, 2 * M_PI / 2000, 4),
                  *out = predict(&wrong, log, 0.5, &f);
    ck_assert_double_gt(f.rms[0], 2 * M_PI / 2000);
    for (size_t w = 0; w < 8; w++) {
        const size_t first = w * 250, last = first + 250;
        const double least = squares_from(&wrong, log, out, first, last, 0, 0);
        for (int i = 0; i < 4; i++)
            for (int side = -1; side <= 1; side += 2) {
                const double by = side * (i < 2 ? 2e-3 : 2e-2);
                ck_assert_double_gt(squares_from(&wrong, log, out, first, last, i, by),
                                    least * (1 - 1e-3));
            }
    }
    mk_log_free(out);
    mk_log_free(log);
}
END_TEST

START_TEST(a_window_knows_nothing_of_later_readings)
{
    struct mk_model m;
    struct mk_predict_figures f;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    struct mk_log *log = record(&m, 2 * M_PI / 4000, 3), *out = predict(&m, log, 1.0, &f);
    for (size_t k = 1000; k < log->rows; k++)
        log->columns[1].data[k] += 0.3 * sin(0.1 * (double)k);
    struct mk_log *again = predict(&m, log, 1.0, &f);
    for (size_t k = 0; k < 1000; k++)
        for (size_t c = 1; c < 5; c++)
            ck_assert_double_eq(out->columns[c].data[k], again->columns[c].data[k]);
    mk_log_free(again);
    mk_log_free(out);
    mk_log_free(log);
}
END_TEST

START_TEST(dropped_rows_and_readings_do_not_stop_a_prediction)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    struct mk_log *log = record(&m, 2 * M_PI / 4000, 4);
    for (size_t c = 1; c < log->column_count; c++)
        for (size_t k = 3; k < log->rows; k += 17)
            log->columns[c].data[k] = (double)NAN;
    const struct mk_predict_figures f = figures_of(&m, log, 1.0);
    ck_assert_double_lt(f.rms[0], 0.02);
    ck_assert_uint_lt(f.rows, log->rows);
    mk_log_free(log);
}
END_TEST

/* Readings from 1.3 to 1.9 s say nothing of the rig, and no motion leads across them. */
START_TEST(of_what_is_left_out_nothing_is_predicted_and_nothing_goes_on_behind_it)
{
    struct mk_model m;
    struct mk_predict_figures f;
    struct mk_error err = MK_ERROR_INIT;
    const struct mk_left_out stretch = {.log = 4, .from_s = 1.299, .to_s = 1.901, .joint = 1};
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    struct mk_log *log = record(&m, 0, 4), *copy;
    struct mk_log *rest = record_from(&m, (double[]){2.0, -1.0}, 0, 4);
    for (size_t c = 0; c < log->column_count; c++)
        for (size_t k = 700; k < log->rows && log->columns[c].name[0] != 't'; k++)
            log->columns[c].data[k] = rest->columns[c].data[k];
    ck_assert_int_eq(mk_leave_out(log, 3, &stretch, 1, &copy, &err), MK_OK);
    ck_assert_ptr_null(copy);
    ck_assert_int_eq(mk_leave_out(log, 4, &stretch, 1, &copy, &err), MK_OK);
    for (int windows = 0; windows < 2; windows++) {
        struct mk_log *out = predict(&m, copy, windows ? 1.0 : 0.0, &f);
        for (int j = 0; j < 2; j++)
            ck_assert_double_lt(f.rms[j], 1e-3);
        for (size_t k = 0; k < log->rows; k++)
            ck_assert(isnan(mk_log_get(out, "q1")[k]) == (k >= 650 && k <= 950));
        mk_log_free(out);
    }
    mk_log_free(rest);
    mk_log_free(copy);
    mk_log_free(log);
}
END_TEST

/* By the steps of fits, which comparisons of models go by, and by a solver with error control. What
 * a late reading shows of the time before a window each extrapolates in its own way: rows within
 * 4 ms of a start are not compared. */
static void check_steps_of_fits(const struct mk_model *m, const struct mk_log *log, double within)
{
    struct mk_log *fine, *coarse;
    struct mk_predict_figures f, g;
    struct mk_error err = MK_ERROR_INIT;
    struct mk_predict_options o = {.window_s = 0.5};
    size_t failed;
    fine = predict(m, log, o.window_s, &f);
    ck_assert_msg(mk_predict_angles(m, log, &o, &coarse, &g, &failed, &err) == MK_OK, "%s",
                  err.message);
    ck_assert_uint_eq(failed, 0);
    ck_assert_uint_eq(g.windows, f.windows);
    ck_assert_uint_eq(g.rows, f.rows);
    for (int j = 0; j < mk_model_joints(m); j++) {
        const char *name = j == 0 ? "q1" : "q2", *speed = j == 0 ? "dq1" : "dq2";
        const double *a = mk_log_get(fine, name), *b = mk_log_get(coarse, name);
        const double *v = mk_log_get(fine, speed), *w = mk_log_get(coarse, speed);
        const double *y = mk_log_get(log, name), *window = mk_log_get(fine, "window");
        for (size_t k = 0; k < log->rows; k++)
            if (k == 0 || window[k - 1] != window[k])
                ck_assert_double_eq_tol(v[k], w[k], 1e-9);
            else
                ck_assert(isnan(w[k]));
        for (size_t k = 0; k < log->rows; k++)
            if (isnan(y[k]))
                ck_assert(isnan(b[k]));
            else if (k >= 2 && window[k - 2] == window[k])
                ck_assert_double_eq_tol(a[k], b[k], within);
    }
    mk_log_free(fine);
    mk_log_free(coarse);
}

START_TEST(the_steps_of_fits_predict_what_a_solver_predicts)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    struct mk_log *log = record(&m, 2 * M_PI / 4000, 5);
    double *q1 = log->columns[2].data, *q2 = log->columns[3].data;
    q1[300] = q2[700] = q2[701] = NAN; /* readings that are missing */
    check_steps_of_fits(&m, log, 1e-5);
    /* A late reading shows an earlier state; an effect that remembers has a state. */
    add_effect(&m, "sensor-delay", 0, 0.004);
    check_steps_of_fits(&m, log, 2e-5);
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    add_effect(&m, "actuator-lag", 0, 0.01);
    check_steps_of_fits(&m, log, 2e-5);
    mk_log_free(log);
}
END_TEST

START_TEST(a_log_may_begin_at_any_time)
{
    struct mk_model m;
    struct mk_predict_figures early, late;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    struct mk_log *log = record(&m, 0, 3), *first = predict(&m, log, 1, &early);
    double *t = log->columns[0].data;
    for (size_t k = 0; k < log->rows; k++)
        t[k] += 7.25;
    struct mk_log *second = predict(&m, log, 1, &late);
    for (int j = 0; j < 2; j++)
        ck_assert_double_eq_tol(early.rms[j], late.rms[j], 1e-9);
    mk_log_free(first);
    mk_log_free(second);
    mk_log_free(log);
}
END_TEST

START_TEST(offsets_and_delays_of_the_model_are_in_the_prediction)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    add_effect(&m, "encoder-offset", 1, 0.1);
    add_effect(&m, "input-delay", 0, 0.0113);
    struct mk_log *log = record(&m, 0, 3);
    ck_assert_double_lt(figures_of(&m, log, 0).nrmse[0], 4e-3);
    mk_log_free(log);
}
END_TEST

static enum mk_status map_by(enum mk_input input, const char *text, enum mk_plant_kind kind,
                             struct mk_record *rec, struct mk_log **log, struct mk_error *err)
{
    struct mk_model m;
    mk_model_default(kind, &m);
    m.input = input;
    ck_assert_int_eq(mk_log_read(scratch_text("map.csv", text), log, err), MK_OK);
    return mk_record_from_log(*log, &m, rec, err);
}

static enum mk_status map(const char *text, enum mk_plant_kind kind, struct mk_record *rec,
                          struct mk_log **log, struct mk_error *err)
{
    return map_by(MK_INPUT_UNSAID, text, kind, rec, log, err);
}

START_TEST(commands_are_found_under_their_names)
{
    struct mk_record rec;
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(map("t,q1,q2,u\n0,0,0,7\n", MK_PLANT_PENDUBOT, &rec, &log, &err), MK_OK);
    ck_assert(rec.u[0][0] == 7 && !rec.u[1] && !rec.si);
    mk_log_free(log);
    ck_assert_int_eq(map("t,q1,q2,tau1,tau2\n0,0,0,7,8\n", MK_PLANT_PENDUBOT, &rec, &log, &err),
                     MK_OK);
    ck_assert(rec.u[0][0] == 7 && rec.u[1][0] == 8 && rec.si && rec.u_to_torque == 1.0);
    mk_log_free(log);
    ck_assert_int_eq(map("t,q1,tau1\n0,0,7\n", MK_PLANT_PENDULUM, &rec, &log, &err), MK_OK);
    ck_assert(rec.u[0][0] == 7 && rec.si);
    mk_log_free(log);
    ck_assert_int_eq(map("t,q1,q2\n0,0,0\n", MK_PLANT_PENDUBOT, &rec, &log, &err), MK_ERR_PARSE);
    mk_log_free(log);
    ck_assert_int_eq(map("t,q1,u\n0,0,0\n", MK_PLANT_PENDUBOT, &rec, &log, &err), MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "q2"));
    mk_log_free(log);
    ck_assert_int_eq(
        map("# rig: furuta\nt,q1,q2,u\n0,0,0,0\n", MK_PLANT_PENDUBOT, &rec, &log, &err),
        MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "furuta"));
    mk_log_free(log);
}
END_TEST

START_TEST(without_a_command_the_log_or_the_model_must_say_so)
{
    struct mk_model m;
    struct mk_log *log;
    struct mk_record r;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    const char *path = scratch_text(
        "still.csv", "t,q1\n0,1\n0.002,0.999\n0.004,0.998\n0.006,0.997\n0.008,0.996\n");
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_int_eq(mk_record_from_log(log, &m, &r, &err), MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(err.message, "motor = none"));
    ck_assert_ptr_nonnull(strstr(err.message, "input = none"));
    ck_assert_int_eq(mk_log_set_meta(log, "input", "none"), MK_OK);
    ck_assert_int_eq(mk_record_from_log(log, &m, &r, &err), MK_OK);
    ck_assert_ptr_null(r.u[0]);
    mk_log_free(log);
    m.no_motor = true;
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_int_eq(mk_record_from_log(log, &m, &r, &err), MK_OK);
    (void)figures_of(&m, log, 0.0);
    mk_log_free(log);
    /* A command of 0 is none; another one contradicts. */
    path = scratch_text("driven.csv", "t,q1,u\n0,1,0\n0.002,1,0\n");
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_int_eq(mk_record_from_log(log, &m, &r, &err), MK_OK);
    mk_log_free(log);
    path = scratch_text("driven.csv", "t,q1,u\n0,1,0\n0.002,1,0.3\n");
    ck_assert_int_eq(mk_log_read(path, &log, NULL), MK_OK);
    ck_assert_int_eq(mk_record_from_log(log, &m, &r, &err), MK_ERR_PARSE);
    ck_assert_msg(err.line == 3 && strstr(err.message, "nothing drives"), "%d %s", err.line,
                  err.message);
    mk_log_free(log);
}
END_TEST

static enum mk_status map_commanded(const char *text, enum mk_plant_kind kind,
                                    struct mk_record *rec, struct mk_log **log,
                                    struct mk_error *err)
{
    return map_by(MK_INPUT_COMMANDED, text, kind, rec, log, err);
}

START_TEST(a_model_may_ask_for_the_commanded_column)
{
    struct mk_record rec;
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    static const struct {
        const char *text;
        enum mk_plant_kind rig;
        bool two, si;
    } rows[] = {
        {"t,q1,q2,u,u_cmd\n0,0,0,7,9\n", MK_PLANT_PENDUBOT, false, false},
        {"t,q1,q2,u1,u2,u1_cmd,u2_cmd\n0,0,0,7,8,9,5\n", MK_PLANT_PENDUBOT, true, false},
        {"t,q1,q2,tau1,tau2,tau1_cmd,tau2_cmd\n0,0,0,7,8,9,5\n", MK_PLANT_PENDUBOT, true, true},
        {"t,q1,tau1,tau1_cmd\n0,0,7,9\n", MK_PLANT_PENDULUM, false, true},
        {"t,q1,tau_cmd\n0,0,9\n", MK_PLANT_PENDULUM, false, true},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        ck_assert_msg(map_commanded(rows[i].text, rows[i].rig, &rec, &log, &err) == MK_OK, "%s",
                      err.message);
        ck_assert_double_eq(rec.u[0][0], 9);
        ck_assert(rows[i].two ? rec.u[1] && rec.u[1][0] == 5 : !rec.u[1]);
        ck_assert_int_eq(rec.si, rows[i].si);
        mk_log_free(log);
    }
    ck_assert_int_eq(
        map_commanded("t,q1,q2,tau1,tau2\n0,0,0,7,8\n", MK_PLANT_PENDUBOT, &rec, &log, &err),
        MK_ERR_PARSE);
    ck_assert_msg(strstr(err.message, "tau1_cmd") && strstr(err.message, "input = commanded") &&
                      strstr(err.message, "the measured tau1 is taken"),
                  "%s", err.message);
    mk_log_free(log);
    ck_assert_int_eq(map_commanded("t,q1,q2,tau1,tau2,tau1_cmd\n0,0,0,7,8,9\n", MK_PLANT_PENDUBOT,
                                   &rec, &log, &err),
                     MK_ERR_PARSE);
    ck_assert_msg(strstr(err.message, "no column tau2_cmd"), "%s", err.message);
    mk_log_free(log);
}
END_TEST

/* Windows are shorter than the delay: all that acts in them was sent before they begin. */
START_TEST(a_window_knows_the_commands_that_are_on_their_way)
{
    struct mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    add_effect(&m, "input-delay", 0, 0.2013);
    struct mk_log *log = record(&m, 0, 3);
    const struct mk_predict_figures f = figures_of(&m, log, 0.15);
    ck_assert_double_lt(f.rms[0], 1e-5);
    ck_assert_double_lt(f.rms[1], 1e-5);
    mk_log_free(log);
}
END_TEST

START_TEST(logs_too_short_to_predict_are_refused)
{
    struct mk_model m;
    struct mk_log *log, *out;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    ck_assert_int_eq(mk_log_read(scratch_text("s.csv", "t,q1,u\n0,0,0\n"), &log, &err), MK_OK);
    ck_assert_int_ne(mk_predict(&m, log, NULL, &out, NULL, NULL, &err), MK_OK);
    ck_assert_ptr_null(out);
    mk_log_free(log);
}
END_TEST

/* Where a measured log is, if there are any. */
static bool measured(const char *name, char *path, size_t size)
{
    char data[256];
    snprintf(data, sizeof data, "data/%s", name);
    const char *there = shared_path(data);
    if (there)
        snprintf(path, size, "%s", there);
    else
        fprintf(stderr, "skipped: no measured log %s\n", name);
    return there != NULL;
}

START_TEST(numbers_that_no_rig_has_are_told)
{
    static const struct {
        const char *text, *says; /* NULL: nothing */
    } rows[] = {{"0,0,0\n0.1,0.01,1\n0.2,0.02,1\n0.3,0.03,1\n", NULL},
                {"0,0,0\n0.1,0.01,1e30\n0.2,0.02,1e30\n0.3,0.03,1\n",
                 "the command reaches 1e+30 and is beyond the model's u_max = 10 in 2 of 4 rows"},
                {"0,1e30,0\n0.1,1e30,1\n0.2,1e30,1\n0.3,1e30,1\n",
                 "q1 reaches 1e+30 rad: that is no angle of a rig"}};
    char text[256], out[2048];
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        snprintf(text, sizeof text, "t,q1,u\n%s", rows[i].text);
        int code = run_mechkit(out, sizeof out, "simulate --model %s --input %s --out %s",
                               MK_SOURCE_DIR "/models/pendulum.ini",
                               scratch_text("numbers.csv", text), scratch("numbers_out.csv"));
        ck_assert_msg(code == 0 || rows[i].says, "%d %s", code, out);
        ck_assert_msg(rows[i].says ? strstr(out, rows[i].says) != NULL : !strstr(out, "mechkit:"),
                      "%zu: %s", i, out);
    }
}
END_TEST

/* A model and the mapping beside it count from the same zeros. */
START_TEST(models_of_real_rigs_follow_their_logs)
{
    static const struct {
        const char *model, *map, *log;
        double window, nrmse;
    } cases[] = {
        {"double-pendulum-dfki-c1", "double-pendulum-dfki", "pendubot-dfki-c1-sysid/run_143601.csv",
         0.2, 0.06},
        {"pendulum-dfki", "pendulum-dfki", "single-pendulum-dfki/ddp.csv", 0.2, 0.02},
        {"furuta-qube-servo1", "furuta-qube-servo1", "furuta-qube-servo1/ep_163955.csv", 0.1, 0.6},
    };
    char path[512], model[512], mapping[512];
    if (!measured(cases[_i].log, path, sizeof path))
        return;
    struct mk_model m;
    struct mk_import_map map;
    struct mk_table *table;
    struct mk_log *log;
    struct mk_error err = MK_ERROR_INIT;
    snprintf(model, sizeof model, MK_SOURCE_DIR "/models/measured/%s.ini", cases[_i].model);
    snprintf(mapping, sizeof mapping, MK_SOURCE_DIR "/models/measured/%s.map", cases[_i].map);
    ck_assert_msg(mk_model_read(model, &m, &err) == MK_OK, "%s", err.message);
    ck_assert_msg(mk_import_map_read(mapping, &map, &err) == MK_OK, "%s", err.message);
    ck_assert_msg(mk_import_open(path, &map, &table, &err) == MK_OK, "%s", err.message);
    ck_assert_msg(mk_import_apply(table, path, &map, &log, &err) == MK_OK, "%s", err.message);
    mk_table_free(table);
    const double nrmse = figures_of(&m, log, cases[_i].window).nrmse[0];
    ck_assert_msg(nrmse < cases[_i].nrmse, "%s: %g", cases[_i].log, nrmse);
    mk_log_free(log);
}
END_TEST

Suite *suite_predict(void)
{
    Suite *s = suite_create("predict");
    TCase *t = tcase_create("logs");
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_model_predicts_its_own_log);
    tcase_add_test(t, a_wrong_model_shows_in_the_figures);
    tcase_add_loop_test(t, a_window_starts_where_a_wrong_model_meets_its_readings_best, 0, 2);
    tcase_add_test(t, a_window_knows_nothing_of_later_readings);
    tcase_add_test(t, dropped_rows_and_readings_do_not_stop_a_prediction);
    tcase_add_test(t, of_what_is_left_out_nothing_is_predicted_and_nothing_goes_on_behind_it);
    tcase_add_test(t, the_steps_of_fits_predict_what_a_solver_predicts);
    tcase_add_test(t, a_log_may_begin_at_any_time);
    tcase_add_test(t, offsets_and_delays_of_the_model_are_in_the_prediction);
    tcase_add_test(t, commands_are_found_under_their_names);
    tcase_add_test(t, without_a_command_the_log_or_the_model_must_say_so);
    tcase_add_test(t, a_model_may_ask_for_the_commanded_column);
    tcase_add_test(t, a_window_knows_the_commands_that_are_on_their_way);
    tcase_add_test(t, logs_too_short_to_predict_are_refused);
    tcase_add_test(t, numbers_that_no_rig_has_are_told);
    tcase_add_loop_test(t, models_of_real_rigs_follow_their_logs, 0, 3);
    suite_add_tcase(s, t);
    return s;
}
