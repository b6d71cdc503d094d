// A plant's equations in weak form: each row is an equation averaged over a window.
//
// An equation flow(q, v, a) p = source that holds at every instant holds also times any window
// w(t), summed over time, and for a balance d/dt stock p + flow p = source the derivative moves to
// the window: sum of w flow p - w' stock p = w source. So noise is averaged after the nonlinear
// terms were formed from signals of full bandwidth, and nothing is bent, unlike when the signals
// themselves are filtered hard. What noise the readings leave in a row follows from the equation's
// derivatives by integration by parts: a reading's error e at time m enters with
// w dF/dq - (w dF/dv)' + (w dF/da)''. D. A. Messenger, D. M. Bortz 2021; Bortz et al. 2023.
#ifndef MECHKIT_IDENT_WEAK_HPP
#define MECHKIT_IDENT_WEAK_HPP

#include <functional>
#include <vector>

#include "ident/track.hpp"
#include "mechkit/model.h"

namespace mk
{

constexpr int MAX_EQUATIONS = MK_MAX_JOINTS;

// What the equations say at one sample, all base parameters; and their derivatives by the motion at
// the parameters of the moment.
struct WeakSample {
    double flow[MAX_EQUATIONS][MK_MAX_PARAMETERS] = {};
    double stock[MK_MAX_PARAMETERS] = {}; // of equation 0
    double source[MAX_EQUATIONS] = {};
    double flow_q[MAX_EQUATIONS][MK_MAX_JOINTS] = {}, flow_v[MAX_EQUATIONS][MK_MAX_JOINTS] = {};
    double flow_a[MAX_EQUATIONS][MK_MAX_JOINTS] = {};
    double stock_q[MK_MAX_JOINTS] = {}, stock_v[MK_MAX_JOINTS] = {};
};

// The equations of a plant: a torque equation a joint, or the balance of energy.
struct WeakForm {
    int equations;
    // It has a stock: windows then begin at the log's first row, cut there. Where a rig starts from
    // rest, what it has stored is known all but exactly, and later rows are measured from that.
    bool balance;
    // `model` has the parameters at which derivatives are taken.
    void (*sample)(const mk_model &model, const Track &track, size_t row, WeakSample &out);
};
WeakForm torque_equations(const mk_model &model);
WeakForm energy_balance(const mk_model &model);

// One window of all equations.
struct WeakRow {
    double x[MAX_EQUATIONS][MK_MAX_PARAMETERS];
    double y[MAX_EQUATIONS];
    size_t centre;   // row of the track
    bool starts_log; // no earlier row shares readings with it
    // How the error of each reading around the centre enters, in units of that joint's noise; and
    // what of it comes from the angles' errors alone, those of speed and acceleration left out.
    std::vector<double> noise[MAX_EQUATIONS][MK_MAX_JOINTS];
    std::vector<double> angle_noise[MAX_EQUATIONS][MK_MAX_JOINTS];
};

struct WeakWindow {
    double seconds;
    double per_window; // rows in a window's length

    size_t half(const Track &track) const; // samples on either side of the centre
    size_t hop(const Track &track) const;  // from centre to centre
    // Samples on either side of the centre whose readings enter.
    size_t reach(const Track &track) const { return half(track) + 2; }
};

// Calls visit for every window over rows that were measured.
void each_weak_row(const WeakForm &form, const mk_model &model, const std::vector<Track> &tracks,
                   const WeakWindow &window, const std::function<void(const WeakRow &)> &visit);

} // namespace mk
#endif
