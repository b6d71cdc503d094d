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
    int threads = 2;
    int finalists = 8; // candidates that get a full fit
    mk_progress_fn progress = nullptr;
    void *progress_context = nullptr;
};

class Search
{
  public:
    Search(std::vector<const FitLog *> logs, const SearchOptions &options);

    // All fitted parameters of the model refitted, from a hypothesis (states, noise) or anew.
    bool refit(const mk_model &model, const Hypothesis *from, Hypothesis &out);
    // Carries a fit on until it stands still, its drift too.
    void polish(Hypothesis &h, bool drift_too);
    // The best hypotheses with one effect more than `base`, best first, one entry for an effect at
    // a joint. `only`: no others than these. Not `thorough`: without those that are slow to fit.
    std::vector<Hypothesis> extend(const Hypothesis &base, const std::vector<Candidate> *only,
                                   bool thorough);
    int tried() const { return tried_count; } // candidates of the last extension

    double readings() const { return reading_count; }
    std::atomic<bool> cancelled{false};

  private:
    std::vector<const FitLog *> logs;
    SearchOptions options;
    DataRange data;
    double reading_count = 0.0;
    int tried_count = 0;

    struct Trial {
        Candidate candidate = {};
        FitPoint point;
        double gain = -HUGE_VAL;
    };
    std::mutex talk;

    void screen(const Hypothesis &base, const FitOptions &loose, const std::vector<Candidate> &all,
                std::vector<double> &gain);
    static double promised(const FitPicture &picture, const std::vector<int> &free,
                           const std::vector<int> &wanted);
    static bool worth_trying(const std::vector<Candidate> &all, size_t i);
    double penalty(int parameters) const;
    bool try_out(const Hypothesis &base, const FitOptions &loose, const Candidate &candidate,
                 double reference, Trial &trial);
    std::vector<Hypothesis> compete(const Hypothesis &base, std::vector<Trial> &finalists);
    void finish(Fit &fit, Hypothesis &h) const;
    bool tick(double done, const char *what);
};

} // namespace mk
#endif
