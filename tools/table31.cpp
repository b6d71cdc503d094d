// The report's table 3.1 again: `make table31`.
//
// A pendubot with the parameters (3.30) is driven by 1.5 sin 6t for 10 s at 200 Hz, 30 times. Each
// angle reading carries normally distributed noise, as in chapter 3, of the size that a 4000-count
// encoder's rounding has; the command is exact. First every method fits sets of 30 runs; then
// output error and the linear methods fit single runs with new noise again and again, to compare
// their scatter with the standard errors that they state and with the Cramer-Rao bound. The bound
// is computed here, from differences between simulations, not by the fit.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "mechkit/ident.h"
#include "mechkit/sim.h"

namespace
{

constexpr double RATE_HZ = 200.0, SECONDS = 10.0, G = 9.81;
constexpr int RUNS = 30, COUNT = 7, START = 4;
constexpr int SETS = 20, SLOW_SETS = 4;
constexpr size_t ROWS = (size_t)(RATE_HZ * SECONDS) + 1;
constexpr double TRUTH[COUNT] = {0.0541, 0.0553, 0.0293, 0.7823, 0.3360, 0.1384, 0.1981};
const double NOISE = 2.0 * M_PI / 4000.0 / std::sqrt(12.0);

// Errors that the report prints, in percent.
struct Row {
    const char *method, *name;
    double printed[COUNT];
};
const Row REPORT[] = {{"olsen", "Olsen", {0.068, 1.805, 1.434, 0.189, 1.692, 5.987, 5.021}},
                      {"wls", "Wls", {0.128, 1.731, 1.403, 0.163, 1.618, 5.964, 5.021}},
                      {"sls", "Sls", {0.800, 1.716, 1.318, 0.128, 1.579, 5.479, 5.890}},
                      {"energy", "Eb", {0.033, 4.497, 0.370, 0.026, 4.349, 3.058, 1.165}}};

[[noreturn]] void fail(const char *what, const mk_error &err)
{
    fprintf(stderr, "table31: %s: %s\n", what, err.message);
    exit(1);
}

mk_model pendubot(const double *p)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    m.g = G;
    std::copy_n(p, COUNT, m.parameter);
    m.rtol = 1e-12, m.atol = 1e-13;
    return m;
}

using Angles = Eigen::Matrix<double, Eigen::Dynamic, 2>;

double command(size_t row)
{
    return 1.5 * std::sin(6.0 * (double)row / RATE_HZ);
}

// Angles of a run from hanging rest, off by `start` in q and v.
Angles simulate(const mk_model &model, const double *start)
{
    mk_error err = MK_ERROR_INIT;
    mk_sim *sim = nullptr;
    double x[MK_MAX_STATES] = {-M_PI / 2 + start[0], start[1], start[2], start[3]};
    if (mk_sim_create(&model, nullptr, &sim, &err) != MK_OK ||
        mk_sim_reset(sim, 0.0, x, nullptr) != MK_OK)
        fail("simulation", err);
    Angles out((long)ROWS, 2);
    for (size_t k = 0; k < ROWS; k++) {
        double y[MK_MAX_JOINTS], u[MK_MAX_INPUTS] = {command(k), 0.0};
        mk_sim_measure(sim, y);
        out.row((long)k) << y[0], y[1];
        if (mk_sim_advance(sim, (double)(k + 1) / RATE_HZ, u, &err) != MK_OK)
            fail("simulation", err);
    }
    mk_sim_destroy(sim);
    return out;
}

// Standard errors, relative to the parameters, that no unbiased fit of `runs` runs can beat: start
// states unknown, one for each run.
Eigen::VectorXd cramer_rao(int runs)
{
    Eigen::MatrixXd j(2 * (long)ROWS, COUNT + START);
    for (int i = 0; i < COUNT + START; i++) {
        double p[2][COUNT], start[2][START] = {};
        double step = i < COUNT ? 1e-5 * TRUTH[i] : 1e-5;
        for (int side = 0; side < 2; side++) {
            std::copy_n(TRUTH, COUNT, p[side]);
            (i < COUNT ? p[side][i] : start[side][i - COUNT]) += side ? step : -step;
        }
        Angles d = simulate(pendubot(p[1]), start[1]) - simulate(pendubot(p[0]), start[0]);
        j.col(i) = Eigen::Map<Eigen::VectorXd>(d.data(), d.size()) / (2.0 * step * NOISE);
    }
    Eigen::MatrixXd f = j.transpose() * j;
    Eigen::MatrixXd mixed = f.topRightCorner(COUNT, START);
    Eigen::MatrixXd information =
        f.topLeftCorner(COUNT, COUNT) -
        mixed * f.bottomRightCorner(START, START).inverse() * mixed.transpose();
    Eigen::VectorXd e = (information.inverse() / runs).diagonal().cwiseSqrt();
    return e.cwiseQuotient(Eigen::Map<const Eigen::VectorXd>(TRUTH, COUNT));
}

struct FreeLog {
    void operator()(mk_log *log) const { mk_log_free(log); }
};
using Log = std::unique_ptr<mk_log, FreeLog>;

Log noisy_log(const Angles &clean, std::mt19937_64 &random)
{
    std::normal_distribution<double> normal(0.0, NOISE);
    mk_log *log = nullptr;
    mk_error err = MK_ERROR_INIT;
    if (mk_log_create(ROWS, &log) != MK_OK)
        fail("memory", err);
    double *t = mk_log_add_column(log, "t"), *q1 = mk_log_add_column(log, "q1");
    double *q2 = mk_log_add_column(log, "q2"), *u = mk_log_add_column(log, "u");
    for (size_t k = 0; k < ROWS; k++) {
        t[k] = (double)k / RATE_HZ;
        q1[k] = clean((long)k, 0) + normal(random);
        q2[k] = clean((long)k, 1) + normal(random);
        u[k] = command(k);
    }
    return Log(log);
}

std::unique_ptr<mk_ident_result> fit(const char *method, const std::vector<Log> &logs)
{
    double start[COUNT];
    for (int i = 0; i < COUNT; i++)
        start[i] = TRUTH[i] * (i % 2 ? 0.8 : 1.2);
    mk_model model = pendubot(start);
    mk_ident_options options = {};
    options.method = method;
    std::vector<const mk_log *> views;
    for (const Log &log : logs)
        views.push_back(log.get());
    auto r = std::make_unique<mk_ident_result>();
    mk_error err = MK_ERROR_INIT;
    if (mk_identify(&model, views.data(), views.size(), &options, r.get(), &err) != MK_OK)
        fail(method, err);
    return r;
}

double percent(const mk_ident_result &r, int i)
{
    return 100.0 * (r.parameter[i].value / TRUTH[i] - 1.0);
}

double rms(const double *e)
{
    double sum = 0.0;
    for (int i = 0; i < COUNT; i++)
        sum += e[i] * e[i] / COUNT;
    return std::sqrt(sum);
}

void print_row(const char *name, const char *whose, const double *e, double seconds, int sets)
{
    printf("%-13s %-7s", name, whose);
    for (int i = 0; i < COUNT; i++)
        printf(" %7.3f", std::fabs(e[i]));
    printf("  %7.3f", rms(e));
    if (seconds >= 0.0)
        printf("  %6.2f s  %3d", seconds, sets);
    printf("\n");
}

// Root mean square over several sets of 30 runs of the errors of every method, beside the report's,
// whose set is one.
void table(const Angles &clean)
{
    printf("Pendubot, parameters (3.30), 1.5 sin 6t, %d runs of %g s at %g Hz, noise %.3g rad\n"
           "Errors in percent, rms over sets of such runs; the report had one set\n\n%-21s",
           RUNS, SECONDS, RATE_HZ, NOISE, "");
    for (int i = 0; i < COUNT; i++)
        printf("      p%d", i + 1);
    printf("      rms   a fit   sets\n");
    for (const char *method : {"olsen", "wls", "sls", "energy", "swevers", "output-error"}) {
        int sets = strcmp(method, "output-error") == 0 ? SLOW_SETS : SETS;
        double e[COUNT] = {}, seconds = 0.0;
        for (int set = 0; set < sets; set++) {
            std::mt19937_64 random(31 + (unsigned)set);
            std::vector<Log> logs;
            for (int i = 0; i < RUNS; i++)
                logs.push_back(noisy_log(clean, random));
            auto r = fit(method, logs);
            seconds += r->seconds / sets;
            for (int i = 0; i < COUNT; i++)
                e[i] += percent(*r, i) * percent(*r, i) / sets;
        }
        for (double &x : e)
            x = std::sqrt(x);
        print_row(method, "here", e, seconds, sets);
        for (const Row &row : REPORT)
            if (std::string(row.method) == method)
                print_row("", "report", row.printed, -1.0, 1);
        fflush(stdout);
    }
    Eigen::VectorXd bound = 100.0 * cramer_rao(RUNS);
    print_row("Cramer-Rao", "bound", bound.data(), -1.0, 0);
    printf("\n");
}

// Scatter of a method's fits of single runs: bias and scatter in units of the bound, and how often
// the 95 % intervals hold the truth.
void scatter(const char *method, const Angles &clean, const Eigen::VectorXd &bound, int draws)
{
    double sum[COUNT] = {}, square[COUNT] = {}, stated[COUNT] = {}, covered[COUNT] = {}, all = 0.0;
    std::mt19937_64 random(200);
    for (int d = 0; d < draws; d++) {
        std::vector<Log> logs;
        logs.push_back(noisy_log(clean, random));
        auto r = fit(method, logs);
        for (int i = 0; i < COUNT; i++) {
            double e = r->parameter[i].value - TRUTH[i], s = r->parameter[i].std_error;
            sum[i] += e, square[i] += e * e, stated[i] += s * s;
            covered[i] += std::fabs(e) <= 1.959964 * s;
        }
    }
    double n = draws;
    printf("%-13s variance / bound", method);
    for (int i = 0; i < COUNT; i++)
        printf(" %7.2f",
               (square[i] - sum[i] * sum[i] / n) / (n - 1.0) / std::pow(bound(i) * TRUTH[i], 2));
    printf("\n%13s bias / scatter  ", "");
    for (int i = 0; i < COUNT; i++)
        printf(" %7.2f", sum[i] / n / std::sqrt((square[i] - sum[i] * sum[i] / n) / (n - 1.0)));
    printf("\n%13s stated / scatter", "");
    for (int i = 0; i < COUNT; i++)
        printf(" %7.2f",
               std::sqrt(stated[i] / n / ((square[i] - sum[i] * sum[i] / n) / (n - 1.0))));
    printf("\n%13s coverage, %%     ", "");
    for (int i = 0; i < COUNT; i++) {
        printf(" %7.1f", 100.0 * covered[i] / n);
        all += 100.0 * covered[i] / n / COUNT;
    }
    printf("  all %.1f\n", all);
    fflush(stdout);
}

} // namespace

int main(int argc, char **argv)
{
    // Usage: table31 [DRAWS [METHOD...]]
    int draws = argc > 1 ? atoi(argv[1]) : 200;
    std::vector<std::string> methods(argv + std::min(argc, 2), argv + argc);
    if (methods.empty())
        methods = {"output-error", "olsen", "swevers", "wls", "sls", "energy"};
    const double still[START] = {};
    Angles clean = simulate(pendubot(TRUTH), still);
    if (argc < 3)
        table(clean);
    Eigen::VectorXd bound = cramer_rao(1);
    printf("Single runs, %d draws of the noise\n\n", draws);
    for (const std::string &method : methods)
        scatter(method.c_str(), clean, bound, draws);
    return 0;
}
