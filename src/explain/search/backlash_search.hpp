// Fits of backlash: two sides of a joint that touch now and then, one of them hidden from the
// readings.
//
// Over a short time a trajectory hardly depends on when exactly there was contact; over a long one
// it does, and optima lie side by side. So what follows the beginnings of the logs leads to what
// follows a little more of them (progressive horizon of a single-shooting fit).
#ifndef MECHKIT_EXPLAIN_SEARCH_BACKLASH_SEARCH_HPP
#define MECHKIT_EXPLAIN_SEARCH_BACKLASH_SEARCH_HPP

#include <functional>
#include <vector>

#include "explain/search/candidates.hpp"

namespace mk
{

// Backlash fitted to the logs from one start.
struct BacklashFit {
    Candidate start = {};
    FitPoint point;
    double nlml = HUGE_VAL; // minus log likelihood of all readings
};

class BacklashSearch
{
  public:
    // `loose`: of its fits. `base`: the model without the backlash, as fitted. `least`: the score
    // to be beaten. All must outlive the search.
    BacklashSearch(const std::vector<const FitLog *> &logs_in, const FitOptions &loose_in,
                   const FitPoint &base_in, double least_in)
        : logs(logs_in), loose(loose_in), base(base_in), least(least_in)
    {
    }
    // The best of what the starts lead to, best first; none that does not beat `least`. `go_on`:
    // told the share that is done, false to end early.
    std::vector<BacklashFit> run(const std::vector<Candidate> &starts, int threads,
                                 const std::function<bool(double)> &go_on);
    double work = 0.0; // in passes over the data
    // Nothing else explains the data yet: values far from the fit are begun from as well, and once
    // more where all starts have come to nothing.
    bool afresh = true;

  private:
    enum class From { refit, given, intervals };
    struct Attempt;

    const std::vector<const FitLog *> &logs;
    const FitOptions &loose;
    const FitPoint &base;
    const double least;

    void begin(Attempt &a) const;
    void advance(Attempt &a, const std::vector<const FitLog *> &part, double reach,
                 int threads) const;
    std::vector<Attempt> attempts_from(const std::vector<Candidate> &starts) const;
    void advance_all(std::vector<Attempt> &attempts, double reach, int threads) const;
    static bool led_astray(const std::vector<Attempt> &attempts);
    std::vector<BacklashFit> conclude_all(std::vector<Attempt> &attempts, int threads);
    size_t thin_out(std::vector<Attempt> &attempts, double reach, bool followed) const;
    bool conclude(const Attempt &a, int threads, BacklashFit &out);
};

} // namespace mk
#endif
