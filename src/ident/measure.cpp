// Simple experiments: the table of them.
#include "ident/measure.hpp"
#include "base/dense.hpp"

#include <cstring>
#include <limits>
#include <memory>
#include <new>

namespace mk
{

namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

const Measure *const table[] = {&measure_friction, &measure_inertia, &measure_swing,
                                &measure_torque};
constexpr int COUNT = sizeof table / sizeof table[0];

} // namespace

} // namespace mk

int mk_measure_count(void)
{
    return mk::COUNT;
}

const mk_measure_info *mk_measure_kind(int index)
{
    return index >= 0 && index < mk::COUNT ? &mk::table[index]->info : nullptr;
}

const mk_measure_info *mk_measure_by_name(const char *name)
{
    for (const mk::Measure *m : mk::table)
        if (strcmp(m->info.name, name) == 0)
            return &m->info;
    return nullptr;
}

enum mk_status mk_measure(const char *kind, const mk_model *model, const mk_log *const *logs,
                          size_t log_count, const mk_measure_options *options, mk_measurement *out,
                          mk_error *err)
{
    const mk::Measure *row = nullptr;
    for (const mk::Measure *m : mk::table)
        if (strcmp(m->info.name, kind) == 0)
            row = m;
    if (!row)
        return mk_error_set(err, MK_ERR_NOTFOUND, "there is no measurement '%s'", kind);
    if (!(row->info.plants & (1u << model->plant)))
        return mk_error_set(err, MK_ERR_NOTSUP, "%s cannot be measured on the %s", kind,
                            mk_plant(model->plant)->name);
    enum mk_status st = mk_model_check(model, err);
    try {
        mk::MeasureProblem problem = {*model, {}, {}, options ? *options : mk_measure_options{}};
        for (size_t i = 0; i < log_count && st == MK_OK; i++) {
            mk_record record;
            st = mk_record_from_log(logs[i], model, &record, err);
            problem.logs.push_back(logs[i]);
            problem.records.push_back(record);
        }
        auto made = std::make_unique<mk_measurement>();
        made->kind = &row->info;
        made->model = *model;
        if (st == MK_OK)
            st = row->run(problem, *made, err);
        if (st == MK_OK)
            *out = *made;
    } catch (const std::bad_alloc &) {
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory to measure in");
    }
    return st;
}
