// The score test's other side: at size zero the information matrix says how exactly the data would
// tell the size, all that is fitted beside it free. A cause of k standard errors raises the log
// likelihood by k^2 / 2 on average; it is named where that reaches what the search asks for.
#include "explain/evidence/detection.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "explain/policy.hpp"
#include "explain/search/causes.hpp"

namespace mk
{

namespace
{

// A cause with more starts than these is not one size but one for each frequency, place or number
// of cycles.
constexpr size_t MOST_STARTS = 3;

struct Limit {
    Candidate candidate = {}; // its first start
    size_t starts = 0;
    double least = 0.0; // of all starts the largest: it would have been seen in any case

    // One size, which the data say something of, within what a fit may come to and what a rig can
    // have: no torque beyond the motor's, no share beyond the whole.
    bool is_known(const mk_model &model) const
    {
        const mk_parameter_info &size = candidate.effect->parameter[candidate.size];
        double most = std::min(candidate.most, size.max);
        if (std::strcmp(size.unit, "N m") == 0)
            most = std::min(most, model.u_max);
        if (size.unit[0] == '\0')
            most = std::min(most, 1.0);
        return starts <= MOST_STARTS && std::isfinite(least) && least <= most;
    }
};

bool has_limit(const Candidate &c)
{
    return c.linear && !is_library(c.effect) && c.effect->state_count == 0;
}

} // namespace

// Standard error of a candidate's size where that is next to nothing; infinite where the data say
// nothing of it.
double Search::error_at_nothing(const Hypothesis &base, const Candidate &candidate)
{
    constexpr double NEXT_TO_NOTHING = 1e-6; // of a torque of a hundredth of the rig's
    FitOptions o = fit_options();
    for (double &d : o.process_noise)
        d = base.process_noise;
    Candidate c = candidate;
    c.value[c.size] *= NEXT_TO_NOTHING;
    FitPoint point = base.point;
    if (!with_candidate(base.point.model, c, point.model))
        return HUGE_VAL;
    std::vector<int> wanted = fitted_parameters(base.point.model);
    wanted.push_back(mk_model_parameter_count(&base.point.model) + candidate.size);
    Fit fit(logs, o);
    const QuadraticModel p = fit.quadratic(point, wanted);
    work += fit.work_done;
    const long last = (long)wanted.size() - 1;
    if (!p.finite || !(p.information(last, last) > 0.0))
        return HUGE_VAL;
    const double variance = Fit::covariance(point.model, p, wanted)(last, last);
    return variance > 0.0 ? std::sqrt(variance) : HUGE_VAL;
}

void find_detection_limits(Search &search, const Hypothesis &best, mk_explanation &out)
{
    const double errors = std::sqrt(2.0 * (policy::ACCEPT_FIRST + search.penalty(1)));
    std::vector<Limit> limits;
    for (const Candidate &c : search.candidates_of(best.point.model)) {
        if (!has_limit(c))
            continue;
        if (limits.empty() || !same_cause(limits.back().candidate, c))
            limits.push_back({c, 0, 0.0});
        Limit &l = limits.back();
        if (++l.starts <= MOST_STARTS)
            l.least = std::max(l.least, errors * search.error_at_nothing(best, c));
    }
    for (const Limit &l : limits)
        if (l.is_known(best.point.model) && out.detection_limit_count < MK_MAX_DETECTION_LIMITS)
            out.detection_limit[out.detection_limit_count++] = {
                l.candidate.effect, l.candidate.joint, l.candidate.size, l.least};
}

} // namespace mk
