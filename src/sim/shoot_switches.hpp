// The shooting kernel where laws switch: steps that end just past the switch, and what its instant
// depends on. A part of shoot_kernel.cc, which alone includes it; the head there has the
// mathematics.
#ifndef MECHKIT_SIM_SHOOT_SWITCHES_HPP
#define MECHKIT_SIM_SHOOT_SWITCHES_HPP

namespace mk
{
inline namespace MK_KERNEL_NS
{

// Where a law switches inside a step (contact), the step ends just past the switch, and another
// goes on. In lanes that switch:
//
// 1. find_switch() looks ahead without derivatives and shortens h to tau - now + PAST.
//
// 2. A law may jump at its switch, and all stages of a step must see one law. So the
// Runge-Kutta step goes up to `hop` before its end, and a straight line under the old law
// covers the rest:
//     y <- y + hop f(y) ,   hop = 2 PAST + h / 1000 ,   the columns likewise.
//
// 3. move_instants() adds what the instant depends on.
template <class Law>
inline void Shooter<Law>::step_to_switch(Base &end)
{
    Base h = end - now, hop = Base(0.0), bare_y[MK_MAX_STATES];
    bool switching[W], any = false;
    int which[W];
    bare_runge_kutta(h, bare_y);
    if (find_switch(h, bare_y, which)) {
        for (int i = 0; i < W; i++) {
            switching[i] = which[i] >= 0;
            any = any || switching[i];
            if (!switching[i])
                continue;
            put(end, i, get(now, i) + get(h, i));
            put(hop, i, 2.0 * PAST + 1e-3 * get(h, i));
        }
        count_steps(switching);
    }
    // A law may jump at its switch: up to there all of the step is under the old one.
    runge_kutta(h - hop);
    if (!any && !on_switch)
        return;
    derivative(end - hop, y, stage);
    for (int s = 0; s < ns; s++)
        y.v[s] += hop * stage.v[s];
    for (int d = 0; d < ns * columns; d++)
        y.d[d] += hop * stage.d[d];
    move_instants(end, any ? which : nullptr, stage.v);
}

// The length h of this step depends on the columns: it begins at a switch (dtau/dc in `passed`,
// 0 where it began at none) and ends at a switch or at a time that stands still. y was computed
// with h held, so
//     dy/dc <- dy/dc + f(y) dh/dc ,
//     dh/dc = -passed                          to a fixed end ,
//     dh/dc = -(dg/dc) / (dg/dt)               to a switch g = 0 ,   passed <- passed + dh/dc .
// The next step, under the new law, subtracts `passed` again times its own slope: together
// (f_before - f_after) dtau/dc. `slopes` are f(y) under the old law.
template <class Law>
inline void Shooter<Law>::move_instants(const Base &end, const int *which, const Base *slopes)
{
    Base instant[MOST_COLUMNS + 1];
    for (int d = 0; d < columns; d++)
        instant[d] = -passed.d[d]; // the end stands still
    if (which)
        instants(end, which, slopes, instant);
    for (int s = 0; s < ns; s++)
        for (int d = 0; d < columns; d++)
            y.d[s * columns + d] += instant[d] * slopes[s];
    on_switch = false;
    for (int i = 0; i < W; i++) {
        bool switching = which && which[i] >= 0;
        lane[i].switched = switching ? lane[i].switched + 1 : 0;
        on_switch = on_switch || switching;
        for (int d = 0; d < columns; d++)
            put(passed.d[d], i, switching ? get(passed.d[d], i) + get(instant[d], i) : 0.0);
    }
}

// dh/dc by the implicit function theorem: g(y(h, c), c) = 0 for all c, so that
//     dg/dc + (dg/dt) dh/dc = 0 ,   dg/dt = sum_s (dg/dx_s) f_s ,
// with dg/dc the total derivative at a fixed h (chain). g does not depend on time by itself. A
// grazing contact, dg/dt = 0, keeps the value for a fixed end.
template <class Law>
inline void Shooter<Law>::instants(const Base &end, const int *which, const Base *slopes,
                                   Base *instant)
{
    Scalar g[MK_MAX_EVENTS];
    look_at(y.v);
    mk::events(c, in_log(end), seen, g);
    for (int e = 0; e < c.event_count; e++) {
        bool wanted = false;
        for (int i = 0; i < W; i++)
            wanted = wanted || which[i] == e;
        if (!wanted)
            continue;
        Base rate = Base(0.0);
        Row row;
#if MK_DERIVATIVES
        Scalar::each(g[e].mask & states_mask(), [&](int s) { rate += g[e].d[s] * slopes[s]; });
#else
        (void)slopes;
#endif
        chain(g[e], y, row.d);
        for (int d = 0; d < columns; d++)
            for (int i = 0; i < W; i++)
                if (which[i] == e && get(rate, i) != 0.0)
                    put(instant[d], i, -get(row.d[d], i) / get(rate, i));
    }
}

// Which law switches in which lane (-1: none) on the way over h to y; shortens h there to what
// it takes to get just past it. False: nowhere. A switch is a change of sign of g_e between
// both ends; of several the one that a straight line puts first. Two changes within one step
// are not seen.
template <class Law>
inline bool Shooter<Law>::find_switch(Base &h, const Base *y_end, int *which) const
{
    Base ga[MK_MAX_EVENTS], gb[MK_MAX_EVENTS];
    bool any = false;
    mk::events(bare, in_log(now), x.v, ga);
    mk::events(bare, in_log(now + h), y_end, gb);
    for (int i = 0; i < W; i++) {
        which[i] = -1;
        double share = 1.0;
        if (!lane[i].task || lane[i].switched >= MOST_PARTS || get(h, i) < 10.0 * PAST)
            continue;
        for (int e = 0; e < c.event_count; e++) {
            // Share of h at which a straight line through both ends is 0.
            double va = get(ga[e], i), vb = get(gb[e], i);
            if ((va > 0.0) != (vb > 0.0) && va / (va - vb) <= share) {
                share = va / (va - vb);
                which[i] = e;
            }
        }
        any = any || which[i] >= 0;
    }
    if (!any)
        return false;
    Base a = pick(ga, which), b = pick(gb, which);
    // Root of g along the trajectory: from the straight line, three steps of the chord method,
    // whose slope stays that of the line,
    //     tau <- tau - g(x(tau)) / rate ,
    // each with a Runge-Kutta step from x of its own. Kept within (0, h).
    Base rate = (b - a) / h, guess = h * (a / (a - b));
    for (int round = 0; round < 3; round++) {
        Base at[MK_MAX_STATES], g[MK_MAX_EVENTS];
        bare_runge_kutta(guess, at);
        mk::events(bare, in_log(now + guess), at, g);
        guess -= pick(g, which) / rate;
        guess = if_positive(guess, guess, 1e-3 * h);
        guess = if_positive(h - guess, guess, 0.999 * h);
    }
    any = false;
    for (int i = 0; i < W; i++) {
        double length = get(guess, i) + PAST;
        if (!(which[i] >= 0 && length < get(h, i))) {
            which[i] = -1;
            continue;
        }
        put(h, i, length);
        any = true;
    }
    return any;
}

// By lane, one of the switching functions.
template <class Law>
inline Base Shooter<Law>::pick(const Base *g, const int *which)
{
    Base r = g[0];
    for (int i = 0; i < W; i++)
        if (which[i] > 0)
            put(r, i, get(g[which[i]], i));
    return r;
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif
