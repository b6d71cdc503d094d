// mk_identify: the table of methods, and what all of them need done before and after.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <iterator>
#include <memory>
#include <new>

#include "ident/left_out.hpp"
#include "ident/method.hpp"
#include "ident/scale.hpp"
#include "sim/record_check.hpp"

namespace
{

const mk::IdentMethod *const methods[] = {&mk::method_output_error, &mk::method_olsen,
                                          &mk::method_swevers,      &mk::method_wls,
                                          &mk::method_sls,          &mk::method_energy};
constexpr int method_count = sizeof methods / sizeof methods[0];

const mk::IdentMethod *find(const char *name)
{
    for (const mk::IdentMethod *m : methods)
        if (strcmp(m->info.name, name) == 0)
            return m;
    return nullptr;
}

constexpr size_t FEWEST_ROWS = 20;

// A log that can be learned from joins the problem; one in which nothing moves does not.
enum mk_status take_log(mk::IdentProblem &problem, const mk_log *log, mk_error *err)
{
    mk_record record;
    enum mk_status st = mk_record_from_log(log, &problem.model, &record, err);
    if (st == MK_OK)
        st = mk::check_record(record, problem.model, *log, FEWEST_ROWS, err);
    if (st != MK_OK || !mk::record_moves(record, problem.model))
        return st;
    for (int j = 0; j < mk_model_joints(&problem.model); j++)
        problem.moves[j] = problem.moves[j] || mk::joint_moves(record, problem.model, j);
    problem.logs.push_back(log);
    problem.records.push_back(record);
    return MK_OK;
}

// All that is doubted of the logs, asked for where the caller did not.
enum mk_status check_data(const mk::IdentProblem &problem, const mk_log *const *logs, size_t count,
                          mk_data_check &check, mk_error *err)
{
    enum mk_status st = MK_OK;
    if (problem.options.data_check)
        check = *problem.options.data_check;
    else
        st = mk_data_check_logs(&problem.model, logs, count, MK_DATA_IDENTIFY,
                                problem.options.threads, &check, err);
    const mk_data_finding *fatal = mk_data_check_fatal(&check);
    if (st == MK_OK && fatal && !problem.options.force)
        return mk_error_at(err, MK_ERR_EXPECT, fatal->file, fatal->line, 0, "%s; %s", fatal->what,
                           fatal->remedy);
    return st;
}

// Rows beyond the limit that make a warning: a command may overshoot where it is clipped for real.
constexpr double MOST_CLIPPED = 0.01;

// A command beyond the model's limit is taken as clipped there, which is wrong where the limit is.
void warn_of_clipping(const mk::IdentProblem &problem, mk_ident_result &r)
{
    size_t beyond = 0, rows = 0;
    for (const mk_record &record : problem.records) {
        for (size_t k = 0; record.u[0] && k < record.rows; k++)
            beyond += std::fabs(record.u[0][k]) > problem.model.u_max * (1.0 + 1e-9);
        rows += record.rows;
    }
    if ((double)beyond > MOST_CLIPPED * (double)rows)
        mk::warn(r,
                 "the command is beyond u_max = %g in %.0f %% of the rows, and taken as clipped "
                 "there: are the units right?",
                 problem.model.u_max, 100.0 * (double)beyond / (double)rows);
}

// The logs, each without what is left out of it.
enum mk_status take_logs(mk::IdentProblem &problem, const mk_log *const *logs, size_t log_count,
                         mk_ident_result &r, mk_error *err)
{
    std::vector<const mk_log *> used(logs, logs + log_count);
    std::vector<mk::OwnedLog> made;
    enum mk_status st = mk::leave_out(problem.model, problem.options.rows, used, made, r.left_out,
                                      &r.left_out_count, err);
    problem.made.assign(std::make_move_iterator(made.begin()), std::make_move_iterator(made.end()));
    for (size_t i = 0; i < log_count && st == MK_OK; i++)
        st = take_log(problem, used[i], err);
    if (st == MK_OK && problem.logs.empty())
        return mk_error_at(err, MK_ERR_RANGE, logs[0]->path, 0, 0,
                           "nothing moves in this log: there is nothing to learn from it");
    return st;
}

void name_parameters(const mk_ident_options &options, mk_ident_result &r)
{
    r.parameter_count = mk_model_parameter_count(&r.model);
    for (int i = 0; i < r.parameter_count; i++) {
        mk_ident_parameter &p = r.parameter[i];
        const mk_parameter_info *info = mk_model_parameter_info(&r.model, i, p.name, sizeof p.name);
        p.unit = mk_model_parameter_unit(&r.model, i);
        p.value = mk_model_parameter(&r.model, i);
        p.initial = options.unknown[i] ? std::nan("") : p.value;
        p.std_error = p.crb = std::nan("");
        p.fixed = options.fixed[i] || info->fit == MK_FIT_FIXED || info->fit == MK_FIT_INTEGER ||
                  !mk_parameter_applies(info, r.model.plant);
    }
}

// A fit with the scale held where the data leave it open: at once where no command acts, else after
// a fit has shown it.
enum mk_status fit_what_is_known(const mk::IdentMethod &method, mk::IdentProblem &problem,
                                 mk_ident_result &r, mk_error *err)
{
    const int holder = mk::scale_holder(problem.model, problem.options.unknown);
    if (holder < 0 || mk::scale_is_held(problem.model, problem.options.fixed))
        return method.fit(problem, r, err);
    const mk_ident_result unfitted = r;
    const bool free = mk::scale_is_free(problem.model, problem.records);
    // Where no inertia is known, they are counted in the first.
    if (free && problem.options.unknown[holder])
        problem.model.parameter[holder] = 1.0;
    problem.options.fixed[holder] = free;
    r.parameter[holder].fixed = free;
    enum mk_status st = method.fit(problem, r, err);
    if (st != MK_OK || (!free && !mk::scale_was_not_found(r, holder)))
        return st;
    if (!free) {
        r = unfitted;
        problem.options.fixed[holder] = r.parameter[holder].fixed = true;
        st = method.fit(problem, r, err);
    }
    if (st == MK_OK)
        mk::tell_ratios(holder, r);
    return st;
}

void warn_of_joints_at_rest(const mk::IdentProblem &problem, mk_ident_result &r)
{
    for (int j = 0; j < mk_model_joints(&problem.model); j++)
        if (!problem.moves[j])
            mk::warn(r, "q%d does not move in these data: is the joint stuck, or its encoder?",
                     j + 1);
}

// Standard errors of the plant's parameters into the model; the one that holds the scale has none.
void keep_errors(mk_ident_result &r)
{
    const int count = std::min(mk_plant(r.model.plant)->parameter_count, r.parameter_count);
    for (int i = 0; i < count; i++) {
        const double e = r.parameter[i].std_error;
        if (!(r.scale_free && i == r.scale_holder))
            r.model.parameter_stderr[i] = std::isfinite(e) ? e : 0.0;
    }
}

} // namespace

int mk_ident_method_count(void)
{
    return method_count;
}

const mk_ident_method_info *mk_ident_method(int index)
{
    return index >= 0 && index < method_count ? &methods[index]->info : nullptr;
}

const mk_ident_method_info *mk_ident_method_by_name(const char *name)
{
    const mk::IdentMethod *m = name ? find(name) : nullptr;
    return m ? &m->info : nullptr;
}

enum mk_status mk_identify(const mk_model *model, const mk_log *const *logs, size_t log_count,
                           const mk_ident_options *options, mk_ident_result *out, mk_error *err)
try {
    auto begin = std::chrono::steady_clock::now();
    mk::IdentProblem problem = {};
    problem.model = *model;
    if (options)
        problem.options = *options;
    const char *name = problem.options.method ? problem.options.method : "output-error";
    const mk::IdentMethod *method = find(name);
    if (!method)
        return mk_error_set(err, MK_ERR_NOTFOUND, "there is no method '%s'", name);
    if (log_count == 0)
        return mk_error_set(err, MK_ERR_INVALID, "a fit needs a log at least");
    auto result = std::make_unique<mk_ident_result>();
    enum mk_status st = mk_model_check(model, err);
    if (st == MK_OK)
        st = check_data(problem, logs, log_count, result->data_check, err);
    if (st == MK_OK)
        st = take_logs(problem, logs, log_count, *result, err);
    if (st != MK_OK)
        return st;
    result->model = *model;
    snprintf(result->method, sizeof result->method, "%s", name);
    name_parameters(problem.options, *result);
    // Whether the scale is free is seen in the data.
    problem.model.no_motor = false;
    st = fit_what_is_known(*method, problem, *result, err);
    if (st != MK_OK)
        return st;
    warn_of_joints_at_rest(problem, *result);
    warn_of_clipping(problem, *result);
    result->model.no_motor = model->no_motor;
    keep_errors(*result);
    result->seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    *out = *result;
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory to fit this much data");
}
