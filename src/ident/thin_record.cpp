// A record with as many rows as a free run can tell apart (ident/thin_record.hpp).
#include "ident/thin_record.hpp"

#include <cmath>

namespace mk
{

// Mean of a command over rows [first, last), each held until the next one. The record's last row is
// not held for any time that is known: by itself it is its own mean.
static double mean_command(const mk_record &r, const double *u, size_t first, size_t last)
{
    double sum = 0.0, time = 0.0;
    for (size_t k = first; k < last && k + 1 < r.rows; k++)
        if (std::isfinite(u[k])) {
            sum += u[k] * (r.t[k + 1] - r.t[k]);
            time += r.t[k + 1] - r.t[k];
        }
    return time > 0.0 ? sum / time : u[first];
}

// Row behind the stretch that begins at `first`.
static size_t end_of_stretch(const mk_record &r, size_t first, double held)
{
    constexpr double NEARLY = 0.95; // times are not read to the last digit
    const auto out = [&r](size_t k) { return r.left_out && r.left_out[k] != 0.0; };
    size_t last = first + 1;
    while (last < r.rows && r.t[last] - r.t[first] < NEARLY * held && out(last) == out(first))
        last++;
    return last;
}

// Appends rows [first, last): the first one, those with the first reading of a joint, and the
// record's last.
static void add_stretch(const mk_record &r, int joints, size_t first, size_t last, ThinRecord &out)
{
    double u[MK_MAX_INPUTS];
    for (int i = 0; i < MK_MAX_INPUTS; i++)
        u[i] = r.u[i] ? mean_command(r, r.u[i], first, last) : 0.0;
    bool read[MK_MAX_JOINTS] = {};
    for (size_t k = first; k < last; k++) {
        double q[MK_MAX_JOINTS];
        bool wanted = k == first || k + 1 == r.rows;
        for (int j = 0; j < joints; j++) {
            const bool takes = !read[j] && !std::isnan(r.q[j][k]);
            q[j] = takes ? r.q[j][k] : (double)NAN;
            read[j] = read[j] || takes;
            wanted = wanted || takes;
        }
        if (!wanted)
            continue;
        out.t.push_back(r.t[k]);
        for (int j = 0; j < joints; j++)
            out.q[j].push_back(q[j]);
        for (int i = 0; i < MK_MAX_INPUTS; i++)
            out.u[i].push_back(u[i]);
        out.left_out.push_back(r.left_out ? r.left_out[k] : 0.0);
    }
}

ThinRecord thinned(const mk_record &r, int joints, double held)
{
    ThinRecord out;
    for (size_t first = 0, last; first < r.rows; first = last) {
        last = end_of_stretch(r, first, held);
        add_stretch(r, joints, first, last, out);
    }
    out.record = r;
    out.record.rows = out.t.size();
    out.record.t = out.t.data();
    for (int j = 0; j < joints; j++)
        out.record.q[j] = out.q[j].data();
    for (int i = 0; i < MK_MAX_INPUTS; i++)
        out.record.u[i] = r.u[i] ? out.u[i].data() : nullptr;
    out.record.left_out = r.left_out ? out.left_out.data() : nullptr;
    out.record.late_us = out.record.flags = nullptr;
    return out;
}

} // namespace mk
