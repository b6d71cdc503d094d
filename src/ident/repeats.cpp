#include "ident/repeats.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <new>

#include "mechkit/signals.h"

namespace mk
{

namespace
{

struct FreeRepeats {
    void operator()(mk_repeats *r) const { mk_repeats_free(r); }
};
using Repeats = std::unique_ptr<mk_repeats, FreeRepeats>;

// The mean of a motion is one only as long as the runs stay together: to a twentieth of the way,
// and of a radian. Commands are the same but for how they were logged.
constexpr double LOOSEST_ANGLE = 0.05, LOOSEST_COMMAND = 0.02;

bool belong_together(const mk_repeats &r, int joints)
{
    for (int s = 0; s < r.signals; s++) {
        double spread = std::sqrt(r.pooled[s * r.signals + s]);
        double loosest = s < joints ? std::min(LOOSEST_ANGLE * r.rms[s], LOOSEST_ANGLE)
                                    : LOOSEST_COMMAND * r.rms[s];
        // Without a command there is nothing to tell repeats by.
        if (!(spread <= loosest) || (s == joints && !(r.rms[s] > 0.0)))
            return false;
    }
    return true;
}

// Cheap things that repeats have in common.
bool alike(const mk_record &a, const mk_record &b)
{
    double span_a = a.t[a.rows - 1] - a.t[0], span_b = b.t[b.rows - 1] - b.t[0];
    if (std::fabs(span_a - span_b) > 0.1 * span_a)
        return false;
    double square[2] = {0.0, 0.0};
    if (!a.u[0] || !b.u[0])
        return false;
    for (size_t k = 0; k < std::min(a.rows, b.rows); k++)
        if (!std::isnan(a.u[0][k]) && !std::isnan(b.u[0][k]))
            square[0] += a.u[0][k] * a.u[0][k], square[1] += b.u[0][k] * b.u[0][k];
    return std::fabs(square[0] - square[1]) <= 0.1 * square[0];
}

Repeats average(const IdentProblem &p, const std::vector<size_t> &members)
{
    std::vector<const mk_log *> logs;
    for (size_t i : members)
        logs.push_back(p.logs[i]);
    mk_repeats *out = nullptr;
    enum mk_status st = mk_average_runs(&p.model, logs.data(), logs.size(), &out, nullptr);
    if (st == MK_ERR_NOMEM)
        throw std::bad_alloc();
    return Repeats(st == MK_OK ? out : nullptr);
}

// Logs in sets of repeats, by the first of each.
std::vector<std::vector<size_t>> sets_of(const IdentProblem &p)
{
    std::vector<std::vector<size_t>> sets;
    int joints = mk_model_joints(&p.model);
    for (size_t i = 0; i < p.logs.size(); i++) {
        auto joins = [&](const std::vector<size_t> &set) {
            if (!alike(p.records[set[0]], p.records[i]))
                return false;
            Repeats pair = average(p, {set[0], i});
            return pair && belong_together(*pair, joints);
        };
        auto set = std::find_if(sets.begin(), sets.end(), joins);
        if (set != sets.end())
            set->push_back(i);
        else
            sets.push_back({i});
    }
    return sets;
}

} // namespace

std::vector<Track> tracks_of(const IdentProblem &p)
{
    std::vector<Track> tracks;
    for (const std::vector<size_t> &set : sets_of(p)) {
        Repeats repeats = set.size() > 1 ? average(p, set) : nullptr;
        mk_record record = p.records[set[0]];
        if (repeats && mk_record_from_log(repeats->mean, &p.model, &record, nullptr) != MK_OK)
            throw std::bad_alloc();
        tracks.push_back(track_of_record(record, p.model));
    }
    return tracks;
}

} // namespace mk
