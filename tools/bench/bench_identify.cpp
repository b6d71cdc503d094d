// What tools/bench/bench.py times of identification: output error on many runs behind one C
// function.
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include "bench_pendubot.hpp"
#include "mechkit/data_check.h"
#include "mechkit/ident.h"

namespace
{

double command(int row)
{
    return 1.5 * std::sin(6.0 * DT * row);
}

struct FreeLog {
    void operator()(mk_log *log) const { mk_log_free(log); }
};
using Log = std::unique_ptr<mk_log, FreeLog>;

Log log_of(const double *angles, int rows)
{
    mk_log *log = nullptr;
    if (mk_log_create((size_t)rows, &log) != MK_OK)
        return nullptr;
    double *t = mk_log_add_column(log, "t"), *u = mk_log_add_column(log, "u");
    double *q1 = mk_log_add_column(log, "q1"), *q2 = mk_log_add_column(log, "q2");
    for (int k = 0; k < rows; k++) {
        t[k] = DT * k, u[k] = command(k);
        q1[k] = angles[2 * k], q2[k] = angles[2 * k + 1];
    }
    return Log(log);
}

} // namespace

// Exact angles of a run from hanging under the command held between rows; out: rows x 2.
EXPORT int bench_angles(const double *parameters, int rows, double *out)
{
    const std::vector<mk_model> models = {pendubot(parameters)};
    const std::vector<double> x0 = {-PI / 2, 0, 0, 0};
    std::vector<double> u, x;
    for (int k = 0; k < rows; k++)
        u.insert(u.end(), {command(k), 0.0});
    mk_batch b = batch_of(models, x0, DT, rows - 1, 1e-12, x);
    b.u = u.data();
    if (mk_simulate_batch(&b, nullptr) != MK_OK)
        return 0;
    for (int k = 0; k < rows; k++)
        out[2 * k] = x[(size_t)(4 * k)], out[2 * k + 1] = x[(size_t)(4 * k + 1)];
    return 1;
}

// Fits `runs` runs of `rows` noisy angles (runs x rows x 2) from the parameters given, which the
// estimate replaces. 0 threads: as many as there are processors. With or without what is done
// before the fit: whether the columns of the logs mean what they say.
EXPORT int bench_identify(const double *angles, int runs, int rows, int threads, int checks,
                          double *parameters)
{
    const mk_data_check nothing_found = {};
    std::vector<Log> logs;
    std::vector<const mk_log *> views;
    for (int i = 0; i < runs; i++) {
        logs.push_back(log_of(angles + (size_t)(2 * rows) * (size_t)i, rows));
        if (!logs.back())
            return 0;
        views.push_back(logs.back().get());
    }
    mk_model m = pendubot(parameters);
    mk_ident_options options = {};
    options.threads = threads;
    options.data_check = checks ? nullptr : &nothing_found;
    auto r = std::make_unique<mk_ident_result>();
    if (mk_identify(&m, views.data(), views.size(), &options, r.get(), nullptr) != MK_OK)
        return 0;
    memcpy(parameters, r->model.parameter, PARAMETERS * sizeof *parameters);
    return 1;
}
