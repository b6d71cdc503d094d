// The search for what is missing: hypotheses, fitted together with all base parameters by maximum
// likelihood, screened cheaply first.
#ifndef MECHKIT_EXPLAIN_SEARCH_SEARCH_HPP
#define MECHKIT_EXPLAIN_SEARCH_SEARCH_HPP

#include <atomic>
#include <cmath>
#include <mutex>

#include "explain/search/candidates.hpp"

namespace mk
{

// A model fitted to the data.
struct Hypothesis {
    Candidate added = {}; // what it has beyond the model it grew from
    FitPoint point;
    QuadraticModel quadratic;
    double process_noise = 0.0; // its intensity, of least nlml
    double penalised_nlml =
        0.0; // minus log likelihood with a penalty for parameters (BIC / 2); less is better
    int free_count = 0;
};

struct SearchOptions {
    const mk_model *given = nullptr;   // base parameters are somewhere near these
    const MassRange *masses = nullptr; // and inertias and moments within these; NULL: anywhere
    int threads = 2;
    int full_fits = 8; // candidates that get a full fit
    // s, see FitOptions. What a model misses within an interval passes for noise of the readings,
    // up to ten times their own in a quarter of a second, and then hides small causes behind large
    // ones; between intervals it is process noise. Most of what is missing shows within a tenth;
    // where it does not the first fit takes half of that (FirstFit).
    double interval = 0.1;
    mk_progress_fn progress = nullptr;
    void *progress_context = nullptr;
};

// Backlash takes so much longer to fit than all else that it is looked for by itself.
enum class Kind { all_but_backlash, backlash };

struct ExtendOptions {
    Kind kind = Kind::all_but_backlash;
    const std::vector<Candidate> *only = nullptr; // no others than these
    bool thorough = true;                         // else without those that are slow to fit
    bool slow_only = false;                       // no others than what is left out else
    bool afresh = true; // backlash: from values far from the fit, too (BacklashSearch::afresh)
    // The base follows its data: what it lacks is small, and shows in a few iterations from there.
    // Only what gains this much (log likelihood, after the penalty) by then is fitted in full.
    bool small = false;
    double process_noise = 0.0; // at which it is looked for then; 0: that of the base
    double least = 0.0;
    double acceptance = HUGE_VAL; // score of a hypothesis to be compared with
};

class Search
{
  public:
    Search(std::vector<const FitLog *> logs, const SearchOptions &options);

    // All fitted parameters of the model refitted, from a hypothesis (states, noise) or anew. From
    // one: with the process noise that it may take, where that is more than the hypothesis has.
    bool refit(const mk_model &model, const Hypothesis *from, Hypothesis &out,
               double process_noise = 0.0);
    // A hypothesis' model fitted at one process noise from another's parameters and states. False
    // where it cannot be, or stays far behind the other at the same process noise, or beyond a cost
    // (FitOptions::worth).
    bool refit_at(const mk_model &model, const Hypothesis &from, double process_noise,
                  Hypothesis &out, double worth = HUGE_VAL);
    // The model as it is, with the states, noise and process noise (at most this) that go best with
    // it; `from`: what to start from, of the same data, or NULL.
    bool follow(const mk_model &model, const Hypothesis *from, double process_noise,
                Hypothesis &out);
    // Carries a fit on until it stands still, its process noise too.
    void polish(Hypothesis &h, bool process_noise_too);
    // The best hypotheses with one effect more than `base`, best first, one entry for an effect at
    // a joint.
    std::vector<Hypothesis> extend(const Hypothesis &base, const ExtendOptions &how);
    // A ranking, best first, with one entry for each cause: the best of its starts.
    static std::vector<Hypothesis> best_of_each(std::vector<Hypothesis> all);
    // Gain in log likelihood that the slope promises of each linear one of some candidates, after
    // the penalty; -infinity for others.
    std::vector<double> promises(const Hypothesis &base, const std::vector<Candidate> &some);
    // Where a search for an effect at a joint starts.
    std::vector<Candidate> starts(const mk_model &model, const char *effect, int joint) const;
    // All that could be added to a model.
    std::vector<Candidate> candidates_of(const mk_model &model) const
    {
        return candidates(model, data);
    }
    double error_at_nothing(const Hypothesis &base, const Candidate &candidate);
    double penalty(int parameters) const; // of a likelihood, for so many more (BIC)
    // Whether nothing is left to be explained: next to no process noise, and white noise.
    bool complete(const Hypothesis &h) const;
    // Whether one shooting interval a log, which has no use for a process noise, leaves the scatter
    // of the readings.
    bool meets_readings(const Hypothesis &h) const;
    // Whether a fit has switched the added effect off, or made it larger than it can be.
    static bool discredited(const Hypothesis &h);
    // Whether a fit has left a cause, the model's last effect, what it is; `starts`: of all causes.
    static bool plausible(const mk_model &model, const Candidate &cause,
                          const std::vector<Candidate> &starts);
    // Standard error of a parameter of the model's effect number `effect`, over its value;
    // infinite where the data say nothing of it, 0 where it is not fitted.
    static double relative_error(const Hypothesis &h, int effect, int parameter);
    int tried() const { return tried_count; } // candidates of the last extension
    // All fits so far, in passes over the data (FitOptions::max_passes): counted, so that what is
    // left out for want of time does not depend on the machine.
    double work_done() const { return work; }

    double readings() const { return reading_count; }
    const std::vector<const FitLog *> &training() const { return logs; }
    bool several_logs() const; // the training data are pieces of more than one
    FitOptions usual_options() const { return fit_options(); }
    const SearchOptions &settings() const { return options; }
    std::atomic<bool> cancelled{false};
    // Tells how far a part of the search is (0 to 1); false if it is to stop. From any thread.
    bool tick(double done, const char *what);

  private:
    static constexpr double TIGHTEST = 1e-4; // process noise at which fits end, rad/s per sqrt(s)
    std::vector<const FitLog *> logs;
    SearchOptions options;
    DataRange data = {};
    double reading_count = 0.0;
    int tried_count = 0;
    double work = 0.0;

    struct Trial {
        Candidate candidate = {};
        FitPoint point;
        double gain = -HUGE_VAL;
        double hope = -HUGE_VAL; // gain, and what the last iteration promises of the next
        double work = 0.0;
        bool begun = false;
    };
    struct TryOptions {
        int iterations;
        bool size_only; // the shape stays as it starts
    };
    // The likelihood's slope by the sizes of some candidates, about a model with next to nothing of
    // each.
    struct Slope {
        mk_model model;
        std::vector<size_t> members; // of the candidates, in the model's order
        std::vector<int> free;
        QuadraticModel quadratic;
        bool find(const Hypothesis &base, const std::vector<Candidate> &all,
                  const std::vector<size_t> &group, Fit &fit);
    };
    std::mutex talk;

    void screen(const Hypothesis &base, const FitOptions &loose, const std::vector<Candidate> &all,
                std::vector<double> &gain);
    static double promised(const QuadraticModel &quadratic, const std::vector<int> &free,
                           const std::vector<int> &wanted);
    static bool is_slow(const std::vector<Candidate> &all, size_t i);
    static bool worth_trying(const std::vector<Candidate> &all, size_t i, const ExtendOptions &how);
    void polish(Fit &fit, Hypothesis &h, bool process_noise_too) const;
    void try_all(const Hypothesis &start, const FitOptions &loose, std::vector<Trial> &trials);
    bool try_out(const Hypothesis &base, const FitOptions &loose, const TryOptions &how,
                 Trial &trial);
    static std::vector<int> without_shape(std::vector<int> free, const mk_model &model,
                                          const Candidate &candidate);
    void thin_out(std::vector<Trial> &trials, size_t most);
    static bool has_others_beside(const std::vector<Trial> &trials, size_t one);
    void try_backlash(const Hypothesis &start, const FitOptions &loose,
                      const std::vector<Candidate> &backlashes, const ExtendOptions &how,
                      std::vector<Trial> &trials);
    std::vector<Candidate> candidates_for(const Hypothesis &base, const ExtendOptions &how) const;
    Hypothesis at_minimum(const Hypothesis &base, const FitOptions &loose);
    std::vector<size_t> worth_a_trial(const std::vector<Candidate> &all,
                                      const std::vector<double> &gain,
                                      const ExtendOptions &how) const;
    std::vector<Trial> worth_a_full_fit(std::vector<Trial> &trials, const ExtendOptions &how) const;
    struct FullFits;
    std::vector<Hypothesis> compete(const Hypothesis &base, double acceptance,
                                    double first_process_noise, std::vector<Trial> trials);
    FitOptions fit_options() const;
    FitOptions trial_options(double process_noise) const;
    double penalised(const QuadraticModel &quadratic, const mk_model &model, int free) const;
    void finish(Fit &fit, Hypothesis &h) const;
};

} // namespace mk
#endif
