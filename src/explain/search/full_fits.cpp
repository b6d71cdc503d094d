// Full fits of the causes that came furthest in trials, side by side (successive elimination).
//
// All begin at the process noise `first`, in three rounds of few iterations; after each, who is far
// behind the leader and does not catch up is dropped. Then the process noise comes down by factors
// of TIGHTER, and where it passes that of the base there as well, so that base and extensions
// compare; each one is fitted to its end, and who is FAR_BEHIND the leader there is not carried on.
// Every fit ends by itself where its nlml has risen (Fit::rises). What counts is the penalised nlml
// at the same process noise.
#include <algorithm>
#include <cmath>

#include "base/parallel.hpp"
#include "explain/search/search.hpp"

namespace mk
{

namespace
{

// Factor from one process noise to the next.
constexpr double TIGHTER = 1.0 / 30.0;
// Log likelihood behind the leader, at the same process noise, from which a full fit is given up.
constexpr double FAR_BEHIND = 40.0;
// Process noise that backlash may need, rad/s per sqrt(s). Models with one shooting interval a log
// are fitted at the first process noise and from here on down, not between.
constexpr double ROUGHEST = 0.05;
constexpr int FEW_ITERATIONS = 5, ALL_ITERATIONS = 20, OF_CONTACT = 6;
constexpr double MOST_PASSES = 400.0; // over the data, at one process noise

} // namespace

struct Search::FullFits {
    struct One {
        Hypothesis best;
        FitPoint point;
        std::vector<int> free;
        double now = HUGE_VAL, earlier = HUGE_VAL; // penalised nlml here, and a round before
        double work = 0.0, converged_at = HUGE_VAL;
        int worse = 0; // process noises in a row after the best
        bool running = true;
    };
    Search &search;
    const double first;
    std::vector<One> fits;

    FullFits(Search &search_in, double first_in, std::vector<Trial> &trials)
        : search(search_in), first(first_in), fits(trials.size())
    {
        for (size_t i = 0; i < fits.size(); i++) {
            fits[i].best.added = trials[i].candidate;
            fits[i].best.penalised_nlml = HUGE_VAL;
            fits[i].point = std::move(trials[i].point);
            fits[i].free = fitted_parameters(fits[i].point.model);
            fits[i].best.free_count = (int)fits[i].free.size();
        }
    }
    double leader() const
    {
        double least = HUGE_VAL;
        for (const One &f : fits)
            least = std::min(least, f.now);
        return least;
    }
    // Threads that have no fit of their own help the others.
    void fit_all(double process_noise, int most_iterations)
    {
        const auto running =
            std::count_if(fits.begin(), fits.end(), [](const One &f) { return f.running; });
        const int threads = search.options.threads;
        const int helpers = std::max(1, threads / std::max(1, (int)running));
        parallel_for(threads, fits.size(), [&](size_t i) {
            if (has_use_for(fits[i], process_noise))
                fit_one(fits[i], process_noise, most_iterations, helpers);
        });
    }
    // Process noises from the first one down by factors of TIGHTER, that of the base among them.
    std::vector<double> descent(double base) const
    {
        constexpr double SAME = 0.9;
        std::vector<double> all;
        for (double d = first; d > SAME * TIGHTEST; d *= TIGHTER) {
            all.push_back(d);
            if (base < SAME * d && base * SAME > TIGHTER * d && base > SAME * TIGHTEST)
                all.push_back(base);
        }
        return all;
    }
    // One shooting interval a log has next to no use for a process noise in between.
    bool has_use_for(const One &f, double process_noise) const
    {
        const bool between = process_noise < first && process_noise > ROUGHEST &&
                             mk_model_hides_joint(&f.point.model);
        return f.running && f.converged_at != process_noise && !between;
    }
    void fit_one(One &f, double process_noise, int most_iterations, int threads) const
    {
        FitOptions o = search.fit_options();
        const bool contact = mk_model_event_count(&f.point.model) > 1;
        o.max_iterations = std::min(contact ? OF_CONTACT : ALL_ITERATIONS, most_iterations);
        o.max_passes = MOST_PASSES;
        o.threads = threads;
        Fit fit(search.logs, o);
        QuadraticModel quadratic;
        f.running = fit.solve_at(f.point, f.free, process_noise, quadratic);
        if (fit.converged)
            f.converged_at = process_noise;
        f.work += fit.work_done;
        f.now =
            f.running ? search.penalised(quadratic, f.point.model, (int)f.free.size()) : HUGE_VAL;
        keep(f, process_noise, quadratic);
    }
    void keep(One &f, double process_noise, const QuadraticModel &quadratic) const
    {
        if (f.now < f.best.penalised_nlml) {
            f.best.point = f.point;
            f.best.quadratic = quadratic;
            f.best.process_noise = process_noise;
            f.best.penalised_nlml = f.now;
            f.worse = 0;
        } else {
            f.worse += Fit::rises(f.now - f.best.penalised_nlml, search.reading_count);
            f.running = f.running && f.worse < Fit::RISES_IN_A_ROW;
        }
    }
    // Some take long to come to nothing. Those go on that are near or come nearer:
    //     now < lead + max(CLOSE, share (from - lead)) ,
    //     earlier - now > CATCHING_UP (now - lead) .
    void drop_hopeless(double from, double acceptance, double share)
    {
        constexpr double CLOSE = 200.0;      // log likelihood
        constexpr double CATCHING_UP = 0.25; // of what is missing, in a few iterations
        const double lead = std::min(leader(), acceptance);
        for (One &f : fits) {
            const bool near = f.now < lead + std::max(CLOSE, share * (from - lead));
            const bool comes =
                std::isfinite(f.earlier) && f.earlier - f.now > CATCHING_UP * (f.now - lead);
            f.running = f.running && (near || comes);
        }
    }
    void drop_far_behind()
    {
        const double lead = leader();
        for (One &f : fits)
            f.running = f.running && f.now < lead + FAR_BEHIND;
    }
    std::vector<Hypothesis> ranked()
    {
        std::vector<Hypothesis> all;
        for (One &f : fits) {
            search.work += f.work;
            if (std::isfinite(f.best.penalised_nlml) && !discredited(f.best))
                all.push_back(std::move(f.best));
        }
        return best_of_each(std::move(all));
    }
};

// `acceptance`: penalised nlml of a hypothesis to be compared with.
std::vector<Hypothesis> Search::compete(const Hypothesis &base, double acceptance, double first,
                                        std::vector<Trial> trials)
{
    FullFits full(*this, first, trials);
    for (double share : {0.5, 0.25, 0.1}) { // of the leader's gain, from round to round
        for (FullFits::One &f : full.fits)
            f.earlier = f.now;
        full.fit_all(first, FEW_ITERATIONS);
        full.drop_hopeless(base.penalised_nlml, acceptance, share);
    }
    const std::vector<double> all = full.descent(base.process_noise);
    for (size_t i = 0; i < all.size() && !cancelled; i++) {
        full.fit_all(all[i], ALL_ITERATIONS);
        full.drop_far_behind();
        tick(0.7 + 0.3 * (double)(i + 1) / (double)all.size(), "fitting causes");
    }
    return full.ranked();
}

} // namespace mk
