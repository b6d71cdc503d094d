// A swing-up trajectory as a log: what it is for stands in the metadata, and is checked.
#include "mechkit/swingup.h"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <new>

#include "ctrl/swingup_solve.hpp"
#include "ctrl/track.h"
#include "mechkit/log.h"
#include "mechkit/number.h"

using namespace mk::swing;

namespace
{

constexpr int N = MK_SWINGUP_STATES;
const char *const columns[2 + N] = {"t", "u", "q1", "q2", "dq1", "dq2"};
constexpr char CONTENT[] = "content", TRAJECTORY[] = "swing-up trajectory";
constexpr double FOLLOWS =
    1e-6; // by how much a row may differ from what follows from the one before
constexpr double AT_GOAL = 1e-4; // rad; rad/s times 10
constexpr double EQUAL = 1e-9;   // relative: numbers that are the same

enum mk_status set_number(mk_log *log, const char *key, double value)
{
    char text[MK_NUMBER_MAX];
    mk_format_double(text, value);
    return mk_log_set_meta(log, key, text);
}

enum mk_status describe(const mk_swingup *s, mk_log *log)
{
    const mk_plant_info *plant = mk_plant(s->model.plant);
    enum mk_status st = mk_log_set_meta(log, CONTENT, TRAJECTORY);
    if (st == MK_OK)
        st = mk_log_set_meta(log, "rig", plant->name);
    if (st == MK_OK)
        st = mk_log_set_meta(log, "to", plant->equilibrium[s->equilibrium].name);
    if (st == MK_OK)
        st = mk_log_set_meta(log, "setup", plant->equilibrium[s->equilibrium].setup);
    const struct {
        const char *key;
        double value;
    } rows[] = {{"rate_hz", s->rate_hz}, {"u_max", s->model.u_max},
                {"limit", s->limit},     {"optimum_s", s->optimum_s},
                {"g", s->model.g},       {"friction_sharpness", s->model.friction_sharpness}};
    for (const auto &row : rows)
        st = st == MK_OK ? set_number(log, row.key, row.value) : st;
    for (int i = 0; i < plant->parameter_count && st == MK_OK; i++)
        st = set_number(log, plant->parameter[i].name, s->model.parameter[i]);
    return st;
}

// --- reading ---------------------------------------------------------------------------------

struct Reader {
    const char *path;
    mk_log *log;
    mk_error *err;

    // Of a line of metadata, which stand on top, one a line.
    int line_of(const char *key) const
    {
        for (size_t i = 0; i < log->meta_count; i++)
            if (strcmp(log->meta[i].key, key) == 0)
                return (int)i + 1;
        return 1;
    }
    enum mk_status no_key(const char *key) const
    {
        return mk_error_at(err, MK_ERR_PARSE, path, log->first_row_line - 1, 0,
                           "the line '# %s: ...' is missing above: mechkit design swingup makes "
                           "such a file",
                           key);
    }
    enum mk_status text(const char *key, const char **out) const
    {
        *out = mk_log_find_meta(log, key);
        return *out ? MK_OK : no_key(key);
    }
    enum mk_status number(const char *key, double low, double high, double *out) const
    {
        const char *value;
        enum mk_status st = text(key, &value);
        if (st == MK_OK && (!mk_parse_double_z(value, out) || !(*out >= low && *out <= high)))
            st = mk_error_at(err, MK_ERR_PARSE, path, line_of(key), 0,
                             "%s = %s: expected a number in %g .. %g", key, value, low, high);
        return st;
    }
};

int equilibrium_named(const mk_plant_info *plant, const char *name)
{
    for (int i = 0; i < plant->equilibrium_count; i++)
        if (strcmp(plant->equilibrium[i].name, name) == 0 && plant->equilibrium[i].setup)
            return i;
    return -1;
}

enum mk_status read_rig(const Reader &r, mk_swingup *s)
{
    const char *content, *rig, *to;
    enum mk_status st = r.text(CONTENT, &content);
    if (st == MK_OK && strcmp(content, TRAJECTORY) != 0)
        st = mk_error_at(r.err, MK_ERR_PARSE, r.path, r.line_of(CONTENT), 0,
                         "content '%s': expected '%s'", content, TRAJECTORY);
    if (st == MK_OK)
        st = r.text("rig", &rig);
    if (st == MK_OK)
        st = r.text("to", &to);
    if (st != MK_OK)
        return st;
    const mk_plant_info *plant = mk_plant_by_name(rig);
    if (!plant || plant->joints != 2)
        return mk_error_at(r.err, MK_ERR_PARSE, r.path, r.line_of("rig"), 0,
                           "rig '%s': expected a rig of two joints of %s", rig, mk_plant_names());
    mk_model_default(plant->kind, &s->model);
    s->equilibrium = equilibrium_named(plant, to);
    return s->equilibrium >= 0
               ? MK_OK
               : mk_error_at(r.err, MK_ERR_PARSE, r.path, r.line_of("to"), 0,
                             "to '%s': expected an equilibrium of the %s that a setup holds", to,
                             plant->name);
}

enum mk_status read_numbers(const Reader &r, mk_swingup *s)
{
    const mk_plant_info *plant = mk_plant(s->model.plant);
    enum mk_status st = r.number("rate_hz", 1.0, 1e5, &s->rate_hz);
    if (st == MK_OK)
        st = r.number("u_max", 1e-9, 1e9, &s->model.u_max);
    if (st == MK_OK)
        st = r.number("limit", 1e-9, s->model.u_max, &s->limit);
    if (st == MK_OK)
        st = r.number("optimum_s", 0.0, 1e3, &s->optimum_s);
    if (st == MK_OK)
        st = r.number("g", 1e-9, 1e3, &s->model.g);
    if (st == MK_OK)
        st = r.number("friction_sharpness", 1e-9, 1e9, &s->model.friction_sharpness);
    for (int i = 0; i < plant->parameter_count && st == MK_OK; i++) {
        const mk_parameter_info *p = &plant->parameter[i];
        st = r.number(p->name, p->min, p->max, &s->model.parameter[i]);
    }
    return st;
}

enum mk_status bad_row(const Reader &r, size_t row, const char *what)
{
    return mk_error_at(r.err, MK_ERR_PARSE, r.path, r.log->first_row_line + (int)row, 0,
                       "%s: the file is damaged, or was changed by hand", what);
}

enum mk_status check_row(const Reader &r, const Dynamics &d, const mk_swingup *s, size_t k)
{
    const double *x = s->x + k * N;
    for (int i = 0; i < N; i++)
        if (!std::isfinite(x[i]))
            return bad_row(r, k, "a number is missing");
    if (k == s->count)
        return MK_OK;
    if (!(std::fabs(s->u[k]) <= s->limit * (1.0 + EQUAL)))
        return bad_row(r, k, "the command is beyond the limit that is named above");
    State next = d.move(State(x[0], x[1], x[2], x[3]), s->u[k], 1.0 / s->rate_hz);
    for (int i = 0; i < N; i++)
        if (!(std::fabs(next(i) - x[N + i]) <= FOLLOWS * (1.0 + std::fabs(next(i)))))
            return bad_row(r, k + 1, "this state does not follow from the one before");
    return MK_OK;
}

// From hanging rest to the equilibrium, but for turns of a joint that the motor does not hold.
enum mk_status check_ends(const Reader &r, const mk_swingup *s)
{
    const mk_plant_info *plant = mk_plant(s->model.plant);
    const double *last = s->x + s->count * N;
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        double off = last[j] - plant->equilibrium[s->equilibrium].q[j];
        if (j != plant->motor_joint)
            off = std::remainder(off, 2.0 * M_PI);
        bool wheel = mk_model_turns_freely(&s->model, j);
        if (std::fabs(s->x[j] - plant->rest[j]) > AT_GOAL || s->x[2 + j] != 0.0)
            return bad_row(r, 0, "the first row is not the rig at rest");
        if ((!wheel && std::fabs(off) > AT_GOAL) ||
            std::fabs(last[2 + j]) > (wheel ? 100.0 : 10.0) * AT_GOAL)
            return bad_row(r, s->count, "the last row is not the equilibrium");
    }
    return MK_OK;
}

enum mk_status read_rows(const Reader &r, mk_swingup *s)
{
    const double *column[2 + N];
    for (int i = 0; i < 2 + N; i++)
        if (!(column[i] = mk_log_get(r.log, columns[i])))
            return mk_error_at(r.err, MK_ERR_PARSE, r.path, r.log->first_row_line - 1, 0,
                               "there is no column %s: expected t,u,q1,q2,dq1,dq2", columns[i]);
    if (r.log->truncated || r.log->rows < 2)
        return bad_row(r, r.log->rows, "the trajectory breaks off");
    s->count = r.log->rows - 1;
    s->u = new double[s->count];
    s->x = new double[r.log->rows * N];
    for (size_t k = 0; k <= s->count; k++) {
        if (!(std::fabs(column[0][k] * s->rate_hz - (double)k) < 1e-6 * (1.0 + (double)k)))
            return bad_row(r, k, "the rows are not a sample apart");
        if (k < s->count)
            s->u[k] = column[1][k];
        for (int i = 0; i < N; i++)
            s->x[k * N + i] = column[2 + i][k];
    }
    const Dynamics d(s->model);
    for (size_t k = 0; k <= s->count; k++) {
        enum mk_status st = check_row(r, d, s, k);
        if (st != MK_OK)
            return st;
    }
    return check_ends(r, s);
}

} // namespace

enum mk_status mk_swingup_write(const char *path, const mk_swingup *s, mk_error *err)
{
    mk_log *log = nullptr;
    double *column[2 + N];
    enum mk_status st = mk_log_create(s->count + 1, &log);
    for (int i = 0; i < 2 + N && st == MK_OK; i++)
        if (!(column[i] = mk_log_add_column(log, columns[i])))
            st = MK_ERR_NOMEM;
    if (st == MK_OK)
        st = mk_log_set_meta(log, "mechkit-log", "1");
    if (st == MK_OK)
        st = describe(s, log);
    if (st == MK_OK) {
        for (size_t k = 0; k <= s->count; k++) {
            column[0][k] = (double)k / s->rate_hz;
            column[1][k] = k < s->count ? s->u[k] : 0.0;
            for (int i = 0; i < N; i++)
                column[2 + i][k] = s->x[k * N + i];
        }
        st = mk_log_write(path, log, err);
    } else {
        mk_error_set(err, st, "no memory to write a swing-up");
    }
    mk_log_free(log);
    return st;
}

// The whole file; on success the reader's log is still there, for messages about lines.
static enum mk_status read_file(Reader &r, mk_swingup **out)
{
    *out = nullptr;
    enum mk_status st = mk_log_read(r.path, &r.log, r.err);
    if (st != MK_OK)
        return st;
    mk_swingup *s = nullptr;
    try {
        s = new mk_swingup();
        st = read_rig(r, s);
        if (st == MK_OK)
            st = read_numbers(r, s);
        if (st == MK_OK)
            st = read_rows(r, s);
    } catch (const std::bad_alloc &) {
        st = mk_error_set(r.err, MK_ERR_NOMEM, "no memory for a swing-up");
    }
    if (st == MK_OK)
        *out = s;
    else
        mk_swingup_free(s);
    return st;
}

enum mk_status mk_swingup_read(const char *path, mk_swingup **out, mk_error *err)
{
    Reader r = {path, nullptr, err};
    enum mk_status st = read_file(r, out);
    mk_log_free(r.log);
    return st;
}

// --- a set-up takes it over
// -----------------------------------------------------------------------

namespace
{

enum mk_status check_value(const Reader &r, const char *key, double its, double ours)
{
    if (std::fabs(its - ours) <= EQUAL * std::fabs(ours))
        return MK_OK;
    return mk_error_at(r.err, MK_ERR_INVALID, r.path, r.line_of(key), 0,
                       "this trajectory is for %s = %.10g, but here it is %.10g: make one with "
                       "mechkit design swingup",
                       key, its, ours);
}

// Whether the trajectory is of what the controller believes, for its equilibrium and its loop.
enum mk_status check_fit(const Reader &r, const mk_swingup *s, const mk_ctrl *ctrl)
{
    const mk_plant_info *its = mk_plant(s->model.plant), *ours = mk_plant(ctrl->model.plant);
    if (its != ours)
        return mk_error_at(r.err, MK_ERR_INVALID, r.path, r.line_of("rig"), 0,
                           "this is a trajectory of the %s, and the rig is a %s", its->name,
                           ours->name);
    const mk_equilibrium *to = &its->equilibrium[s->equilibrium];
    if (strcmp(to->setup, ctrl->ops->name) != 0)
        return mk_error_at(r.err, MK_ERR_INVALID, r.path, r.line_of("to"), 0,
                           "this trajectory leads to %s, which setup %s holds, not %s", to->name,
                           to->setup, ctrl->ops->name);
    enum mk_status st = check_value(r, "rate_hz", s->rate_hz, 1.0 / ctrl->dt);
    if (st == MK_OK)
        st = check_value(r, "u_max", s->model.u_max, ctrl->model.u_max);
    if (st == MK_OK)
        st = check_value(r, "g", s->model.g, ctrl->model.g);
    if (st == MK_OK)
        st = check_value(r, "friction_sharpness", s->model.friction_sharpness,
                         ctrl->model.friction_sharpness);
    for (int i = 0; i < ours->parameter_count && st == MK_OK; i++)
        st = check_value(r, ours->parameter[i].name, s->model.parameter[i],
                         ctrl->model.parameter[i]);
    return st;
}

} // namespace

enum mk_status mk_ctrl_load_swingup(mk_ctrl *ctrl, const char *path, mk_error *err)
{
    mk_swingup *s = nullptr;
    mk_track *track = nullptr;
    Reader r = {path, nullptr, err};
    enum mk_status st = MK_OK;
    if (path && !ctrl->roa)
        return mk_error_set(err, MK_ERR_INVALID, "setup %s does not swing up", ctrl->ops->name);
    if (path) {
        st = read_file(r, &s);
        if (st == MK_OK)
            st = check_fit(r, s, ctrl);
        if (st == MK_OK)
            st = mk_track_create(s, ctrl->roa, &track, err);
        mk_swingup_free(s);
        mk_log_free(r.log);
    }
    if (st != MK_OK)
        return st;
    mk_track_destroy(ctrl->track);
    ctrl->track = track;
    return MK_OK;
}
