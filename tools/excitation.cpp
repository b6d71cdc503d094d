// How much a searched input gains, by fits of made-up logs and not by the bound alone: for each rig
// with a free joint the input of mechkit excite beside a sine of the same amplitude and length, and
// the errors of output-error fits over many noisy, counted logs of each.
//
//     excitation [RIG [DRAWS [TRIES]]]
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <vector>

#include "base/random.h"
#include "mechkit/excite.h"
#include "mechkit/ident.h"
#include "mechkit/signal.h"
#include "mechkit/sim.h"

namespace
{

constexpr double AMPLITUDE = 1.5, SECONDS = 10.0, RATE_HZ = 500.0;
constexpr double TWO_PI = 6.283185307179586;

struct LogFree {
    void operator()(mk_log *log) const { mk_log_free(log); }
};
using Log = std::unique_ptr<mk_log, LogFree>;

void insist(enum mk_status st, const mk_error &err)
{
    if (st == MK_OK)
        return;
    fprintf(stderr, "excitation: %s\n", err.message);
    exit(1);
}

// The rig's true angles under an input, from rest, beside the command.
Log exact(const mk_model &m, const char *input)
{
    mk_error err = MK_ERROR_INIT;
    mk_signal *signal;
    mk_sim *sim;
    mk_log *log;
    size_t rows = (size_t)(SECONDS * RATE_HZ);
    insist(mk_signal_create(input, &signal, &err), err);
    insist(mk_sim_create(&m, nullptr, &sim, &err), err);
    insist(mk_log_create(rows, &log), err);
    double *t = mk_log_add_column(log, "t"), *u = mk_log_add_column(log, "u");
    double *q[2] = {mk_log_add_column(log, "q1"), mk_log_add_column(log, "q2")};
    const double still[2] = {0.0, 0.0};
    double x[MK_MAX_STATES], y[2];
    mk_model_initial_state(&m, mk_plant(m.plant)->rest, still, x);
    insist(mk_sim_reset(sim, 0.0, x, nullptr), err);
    for (size_t k = 0; k < rows; k++) {
        t[k] = (double)k / RATE_HZ;
        double command[2] = {mk_signal_at(signal, t[k]), 0.0};
        u[k] = command[0];
        mk_sim_measure(sim, y);
        q[0][k] = y[0];
        q[1][k] = y[1];
        insist(mk_sim_advance(sim, (double)(k + 1) / RATE_HZ, command, &err), err);
    }
    mk_sim_destroy(sim);
    mk_signal_destroy(signal);
    return Log(log);
}

// Half a count of noise, then whole counts.
Log noisy(const mk_model &m, const mk_log &truth, mk_random &random)
{
    mk_error err = MK_ERROR_INIT;
    mk_log *log;
    insist(mk_log_create(truth.rows, &log), err);
    for (size_t c = 0; c < truth.column_count; c++) {
        double *to = mk_log_add_column(log, truth.columns[c].name);
        memcpy(to, truth.columns[c].data, truth.rows * sizeof *to);
    }
    for (size_t j = 0; j < 2; j++) {
        double count = TWO_PI / m.encoder_cpr[j], *q = log->columns[2 + j].data;
        for (size_t k = 0; k < log->rows; k++)
            q[k] = count * std::round(q[k] / count + 0.5 * mk_random_normal(&random));
    }
    return Log(log);
}

// Root mean square of the relative error of each parameter over the draws; returns the largest.
double errors(const mk_model &m, const char *input, int draws, std::vector<double> &rms)
{
    Log truth = exact(m, input);
    int n = mk_plant(m.plant)->parameter_count;
    rms.assign((size_t)n, 0.0);
    mk_random random = {1};
    auto r = std::make_unique<mk_ident_result>();
    for (int d = 0; d < draws; d++) {
        Log log = noisy(m, *truth, random);
        const mk_log *logs[1] = {log.get()};
        mk_model start = m;
        for (int i = 0; i < n; i++)
            start.parameter[i] *= 1.0 + 0.1 * (mk_random_uniform(&random) - 0.5);
        mk_error err = MK_ERROR_INIT;
        mk_ident_options o = {};
        insist(mk_identify(&start, logs, 1, &o, r.get(), &err), err);
        for (int i = 0; i < n; i++)
            rms[(size_t)i] +=
                std::pow(r->parameter[i].value / m.parameter[i] - 1.0, 2) / (double)draws;
    }
    double worst = 0.0;
    for (double &e : rms) {
        e = std::sqrt(e);
        worst = std::fmax(worst, e);
    }
    return worst;
}

void compare(enum mk_plant_kind kind, int draws, int tries)
{
    mk_model m;
    mk_excite_options o;
    mk_excitation e = {};
    mk_error err = MK_ERROR_INIT;
    mk_model_default(kind, &m);
    mk_excite_default(&m, &o);
    o.u_max = AMPLITUDE;
    o.seconds = SECONDS;
    o.rate_hz = RATE_HZ;
    if (tries > 0)
        o.evaluations = tries;
    insist(mk_excite(&m, &o, &e, &err), err);
    printf("%s: u = %s\n  foreseen largest standard error %.4f %%, of %s %.4f %%: %.2f times\n",
           mk_plant(kind)->name, e.input, 100.0 * e.figures.worst, e.against,
           100.0 * e.against_figures.worst, e.against_figures.worst / e.figures.worst);
    fflush(stdout);
    std::vector<double> sine, best;
    double a = errors(m, e.against, draws, sine), b = errors(m, e.input, draws, best);
    printf("  over %d fits: %.4f %%, of the sine %.4f %%: %.2f times\n", draws, 100.0 * b,
           100.0 * a, a / b);
    for (size_t i = 0; i < best.size(); i++)
        printf("    p%zu %.4f %%, of the sine %.4f %%\n", i + 1, 100.0 * best[i], 100.0 * sine[i]);
    fflush(stdout);
    mk_excitation_clear(&e);
}

} // namespace

int main(int argc, char **argv)
{
    int draws = argc > 2 ? atoi(argv[2]) : 40, tries = argc > 3 ? atoi(argv[3]) : 0;
    for (enum mk_plant_kind kind : {MK_PLANT_PENDUBOT, MK_PLANT_REACTION_WHEEL, MK_PLANT_FURUTA})
        if (argc < 2 || strcmp(argv[1], mk_plant(kind)->name) == 0)
            compare(kind, draws, tries);
    return 0;
}
