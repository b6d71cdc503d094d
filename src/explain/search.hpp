// The search for what is missing: hypotheses, fitted together with all base parameters by maximum
// likelihood, screened cheaply first.
#ifndef MECHKIT_EXPLAIN_SEARCH_HPP
#define MECHKIT_EXPLAIN_SEARCH_HPP

#include <atomic>
#include <cmath>
#include <mutex>

#include "explain/candidates.hpp"

namespace mk
{

// A model fitted to the data.
struct Hypothesis {
    Candidate added = {}; // what it has beyond the model it grew from
    FitPoint point;
    FitPicture picture;
    double drift = 0.0; // process noise of best evidence
    double score =
        0.0; // minus log likelihood with a penalty for parameters (BIC / 2); less is better
    int free_count = 0;
};

struct SearchOptions {
    const mk_model *given = nullptr; // base parameters are somewhere near these
    int threads = 2;
    int finalists = 8; // candidates that get a full fit
    mk_progress_fn progress = nullptr;
    void *progress_context = nullptr;
};

struct ExtendOptions {
    const std::vector<Candidate> *only = nullptr; // no others than these
    bool thorough = true;                         // else without those that are slow to fit
    // The base follows its data: what it lacks is small, and shows in a few iterations from there.
    // Only what gains this much (log likelihood, after the penalty) by then is fitted in full.
    bool small = false;
    double least = 0.0;
};

class Search
{
  public:
    Search(std::vector<const FitLog *> logs, const SearchOptions &options);

    // All fitted parameters of the model refitted, from a hypothesis (states, noise) or anew.
    bool refit(const mk_model &model, const Hypothesis *from, Hypothesis &out);
    // A hypothesis' model fitted at one drift from another's parameters and states.
    bool refit_at(const mk_model &model, const Hypothesis &from, double drift, Hypothesis &out);
    // Carries a fit on until it stands still, its drift too.
    void polish(Hypothesis &h, bool drift_too);
    // The best hypotheses with one effect more than `base`, best first, one entry for an effect at
    // a joint.
    std::vector<Hypothesis> extend(const Hypothesis &base, const ExtendOptions &how);
    // Whether a fit has switched the added effect off.
    static bool vanished(const Hypothesis &h);
    int tried() const { return tried_count; } // candidates of the last extension
    // All fits so far, in passes over the data (FitOptions::max_passes): counted, so that what is
    // left out for want of time does not depend on the machine.
    double work_done() const { return work; }

    double readings() const { return reading_count; }
    std::atomic<bool> cancelled{false};

  private:
    std::vector<const FitLog *> logs;
    SearchOptions options;
    DataRange data;
    double reading_count = 0.0;
    int tried_count = 0;
    double work = 0.0;

    struct Trial {
        Candidate candidate = {};
        FitPoint point;
        double gain = -HUGE_VAL;
        double work = 0.0;
    };
    std::mutex talk;

    void screen(const Hypothesis &base, const FitOptions &loose, const std::vector<Candidate> &all,
                std::vector<double> &gain);
    static double promised(const FitPicture &picture, const std::vector<int> &free,
                           const std::vector<int> &wanted);
    static bool worth_trying(const std::vector<Candidate> &all, size_t i);
    double penalty(int parameters) const;
    void polish(Fit &fit, Hypothesis &h, bool drift_too) const;
    bool try_out(const Hypothesis &base, const FitOptions &loose, const Candidate &candidate,
                 double reference, Trial &trial);
    std::vector<Hypothesis> compete(double first_drift, std::vector<Trial> &finalists);
    FitOptions fit_options() const;
    void finish(Fit &fit, Hypothesis &h) const;
    bool tick(double done, const char *what);
};

} // namespace mk
#endif
