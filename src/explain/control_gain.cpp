// Every setup with each of three models is a job of its own: what comes out does not depend on the
// number of threads.
#include "explain/control_gain.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "base/parallel.hpp"
#include "base/random.h"
#include "experiment/robustness.h"
#include "mechkit/signal.h"

namespace
{

constexpr int RUNS = 5;
// First runs that fail: so do the others then, and each takes long.
constexpr int HOPELESS = 2;
constexpr double RATE_HZ = 500.0;
constexpr double CATCH_S = 6.0;
constexpr double HOLD_S = 4.0;
constexpr double NOISE_COUNTS = 0.3; // readings flicker
constexpr double START_RAD = 0.002;  // links never hang quite the same
constexpr double STEP_RADPS = 20.0;  // of the speed that is tracked, both ways
constexpr const char *STEPS = "%.9g*square(0.25)";
constexpr double UNKNOWN = NAN;

// Of the numbers among them; UNKNOWN when there is none.
double median(const std::array<double, RUNS> &value, int count)
{
    std::vector<double> sorted;
    std::copy_if(value.begin(), value.begin() + count, std::back_inserter(sorted),
                 [](double x) { return std::isfinite(x); });
    if (sorted.empty())
        return UNKNOWN;
    std::sort(sorted.begin(), sorted.end());
    return 0.5 * (sorted[(sorted.size() - 1) / 2] + sorted[sorted.size() / 2]);
}

bool went_well(const trial &t)
{
    // A link that leans because its equilibrium does is held all the same.
    return t.end == TRIAL_HELD || t.end == TRIAL_NOT_STILL;
}

mk_control_figures sum_up(const std::array<trial, RUNS> &trials, int count)
{
    std::array<double, RUNS> caught{}, error{}, off{}, effort{}, peak{};
    int held = 0;
    for (size_t i = 0; i < (size_t)count; i++) {
        const trial &t = trials[i];
        const bool well = went_well(t);
        held += well;
        caught[i] = t.caught_s;
        error[i] = !well ? UNKNOWN : std::isnan(t.track_radps) ? t.sway_rad : t.track_radps;
        off[i] = well ? t.off_rad : UNKNOWN;
        effort[i] = well ? t.effort : UNKNOWN;
        peak[i] = t.u_peak;
    }
    mk_control_figures out = {};
    out.held = (double)held / RUNS;
    out.caught_s = median(caught, count);
    out.error = median(error, count);
    out.off = median(off, count);
    out.effort = median(effort, count);
    out.peak = median(peak, count);
    return out;
}

struct VirtualRig {
    mk_model model;
    double start_rad[MK_MAX_JOINTS];
    mk_signal *steps;
};

enum mk_status try_nominal(const mk_ctrl_ops *setup, const mk_model &nominal, const VirtualRig &rig,
                           mk_control_figures &out)
{
    mk_ctrl *ctrl = nullptr;
    std::array<trial, RUNS> trials;
    enum mk_status st = mk_ctrl_create(setup, &nominal, 1.0 / RATE_HZ, rig.steps, &ctrl, nullptr);
    int done = 0, well = 0;
    while (st == MK_OK && done < RUNS && (well > 0 || done < HOPELESS)) {
        const uint64_t seed = (uint64_t)done + 1;
        mk_random random = {seed};
        trial_setting setting = {};
        setting.rig = &rig.model;
        setting.rate_hz = RATE_HZ;
        setting.catch_s = CATCH_S;
        setting.hold_s = HOLD_S;
        setting.count_noise = NOISE_COUNTS;
        setting.seed = seed;
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            setting.start_rad[j] =
                rig.start_rad[j] + START_RAD * (2.0 * mk_random_uniform(&random) - 1.0);
        trial &now = trials[(size_t)done++];
        st = trial_run_on(ctrl, &setting, &now, nullptr);
        well += st == MK_OK && went_well(now);
    }
    mk_ctrl_destroy(ctrl);
    if (st == MK_OK)
        out = sum_up(trials, done);
    return st;
}

// A setup, believing one of the models.
struct Job {
    const mk_ctrl_ops *setup;
    const mk_model *nominal;
    mk_control_figures figures = {};
    enum mk_status status = MK_OK;
};

// Three jobs for each setup of the plant that can make use of an extension.
std::vector<Job> jobs_of(const mk_explanation &e)
{
    std::vector<Job> jobs;
    const mk_ctrl_ops *setup;
    for (int i = 0; (setup = mk_ctrl_setup(i)) != nullptr; i++)
        if ((setup->plants & (1u << e.extended.plant)) &&
            mk_ctrl_param_index(setup, "compensate") >= 0)
            for (const mk_model *nominal : {&e.given, &e.refit, &e.extended})
                jobs.push_back({setup, nominal});
    return jobs;
}

} // namespace

enum mk_status control_gain_measure(mk_explanation *e, int threads, mk_error *err)
try {
    VirtualRig rig = {};
    e->control_count = 0;
    if (!e->offered || trial_hang(&e->extended, &rig.model, rig.start_rad, nullptr) != MK_OK)
        return MK_OK;
    char steps[48];
    const int motor = mk_plant(e->given.plant)->motor_joint;
    std::snprintf(steps, sizeof steps, STEPS, STEP_RADPS * mk_model_joint_scale(&e->given, motor));
    enum mk_status st = mk_signal_create(steps, &rig.steps, err);
    if (st != MK_OK)
        return st;
    const std::unique_ptr<mk_signal, void (*)(mk_signal *)> owner(rig.steps, mk_signal_destroy);
    std::vector<Job> jobs = jobs_of(*e);
    mk::parallel_for(threads, jobs.size(), [&](size_t i) {
        jobs[i].status = try_nominal(jobs[i].setup, *jobs[i].nominal, rig, jobs[i].figures);
    });
    for (size_t i = 0; i + 2 < jobs.size() && e->control_count < MK_MAX_CONTROL_GAINS; i += 3) {
        const Job *of = &jobs[i]; // given, refit, extended
        // One that cannot be tried, or that holds with none of them, says nothing about this rig.
        bool says = false;
        for (int k = 0; k < 3; k++)
            says = says || of[k].figures.held > 0.0;
        if (of[0].status != MK_OK || of[1].status != MK_OK || of[2].status != MK_OK || !says)
            continue;
        mk_control_gain gain = {};
        gain.setup = of->setup->name;
        gain.runs = RUNS;
        gain.given = of[0].figures;
        gain.refit = of[1].figures;
        gain.extended = of[2].figures;
        e->control[e->control_count++] = gain;
    }
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for trials in control");
}
