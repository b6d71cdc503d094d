// What a report asks of a finished explanation (mechkit/explain.h): whether values, logs or
// held-out data leave a doubt that has to be told beside the verdict.
#include "mechkit/explain.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "explain/policy.hpp"

const char *mk_verdict_name(enum mk_verdict verdict)
{
    static const char *const names[] = {"none", "parameters", "effect", "partial", "unknown"};
    return names[verdict];
}

// With total the sum of squared nrmse over joints (explain/evidence/gain.cpp):
//     total(refitted) > REFIT_BEHIND total(given)   and   > REFIT_OVER_NOISE total(noise) .
// Values that fit some logs and are far worse than the given ones on another: it is hardly of one
// rig.
bool mk_explanation_doubts_logs(const mk_explanation *e)
{
    double before = 0.0, refitted = 0.0, floor = 0.0;
    for (int j = 0; j < mk_model_joints(&e->given); j++) {
        before += e->before[j] * e->before[j];
        refitted += e->refitted[j] * e->refitted[j];
        floor += e->floor[j] * e->floor[j];
    }
    return refitted > mk::policy::REFIT_BEHIND * before &&
           refitted > mk::policy::REFIT_OVER_NOISE * floor;
}

// With c = NOBODY_WEIGHS_SO and the ratio of the fitted value to the given one, whether not
//     1 / c < ratio < c ;
// a sign that changed is a doubt as well. Only ratios of masses to each other are known where the
// scale is free, so none is doubted then.
bool mk_explanation_doubts_mass(const mk_explanation *e, int i)
{
    const bool rest = e->verdict == MK_VERDICT_PARTIAL || e->verdict == MK_VERDICT_UNKNOWN;
    const bool mass = i < mk_plant(e->given.plant)->mass_count;
    if (!rest || !mass || e->unknown[i] || e->scale_free || e->given.parameter[i] == 0.0)
        return false;
    const mk_model &fitted = e->offered ? e->extended : e->refit;
    const double ratio = fitted.parameter[i] / e->given.parameter[i];
    return !(ratio * mk::policy::NOBODY_WEIGHS_SO > 1.0 && ratio < mk::policy::NOBODY_WEIGHS_SO);
}

bool mk_explanation_leaves_little(const mk_explanation *e)
{
    return e->offered && e->budget.closed >= mk::policy::LEAVES_LITTLE;
}

// At some joint the best of the three models is
//     above FAR_FROM_READ times what noise leaves, and above `times` its error on the data to learn
//     from .
static bool misses(const mk_explanation &e, double times)
{
    for (int j = 0; j < mk_model_joints(&e.given); j++) {
        const double least = std::min({e.before[j], e.refitted[j], e.after[j]});
        if (least > mk::policy::FAR_FROM_READ * e.floor[j] && least > times * e.trained[j])
            return true;
    }
    return false;
}

// Either the best model, offered or not, follows the data to learn from (its process noise is a
// TRACE), or it predicts them FAR_FROM_TRAINED times better.
bool mk_explanation_goes_beyond(const mk_explanation *e)
{
    const bool followed = e->process_noise_extended <= mk::policy::TRACE;
    return e->command_beyond > mk::policy::BEYOND &&
           misses(*e, followed ? 0.0 : mk::policy::FAR_FROM_TRAINED);
}

bool mk_explanation_misses_held_out(const mk_explanation *e)
{
    // Nobody predicts when a pulse is lost.
    const bool missed = std::any_of(e->cause, e->cause + e->cause_count, [](const mk_cause &c) {
        return std::strcmp(c.effect->name, "missed-counts") == 0;
    });
    return misses(*e, mk::policy::FAR_FROM_TRAINED) && !missed && e->verdict != MK_VERDICT_UNKNOWN;
}
