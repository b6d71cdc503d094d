// Which causes improve the prediction of data that they were not fitted to: the search where no
// cause leads to a model that follows its data, as on every measured rig.
//
// All is decided by free runs over windows. Every entry of the catalogue is asked for the
// error that a fit with it to all logs but one would leave in that one; who promises most is fitted
// in full and asked again. Causes are added while one of them carries over, and at the end
// each is left out in turn and has to be missed.
#ifndef MECHKIT_EXPLAIN_SEARCH_PREDICTION_SEARCH_HPP
#define MECHKIT_EXPLAIN_SEARCH_PREDICTION_SEARCH_HPP

#include <functional>

#include "explain/evidence/carry_over.hpp"
#include "explain/search/search.hpp"
#include "ident/free_runs.hpp"

namespace mk
{

// What a cause made of data that are left out when it was asked.
struct Asked {
    Candidate cause;
    Carried carried;
};

// A model as free runs fit it.
struct RunFit {
    Candidate cause = {}; // what it has beyond the one that it grew from
    RunPoint point;
    RunQuadraticModel quadratic;
    HeldOutFigures left_out[2]; // of whole folds, and of their second halves
    Carried carried;
    bool fine = false;
};

// A cause that carries over, and what nearly did as well in its place.
struct Carrier {
    Candidate cause;
    Carried carried;
    RunFit without;             // all others
    std::vector<RunFit> rivals; // all others and a rival
};

class PredictionSearch
{
  public:
    // `base`: the refitted model, values per log included. All must outlive the search.
    PredictionSearch(Search &search, FreeRuns &runs, const mk_model &base);
    // Adds causes as long as one carries over. False where the model cannot be run over the data.
    bool run() { return start() && go_on(); }
    // The same step by step: the base fitted, and the first cause if there is one.
    bool start();
    bool add_one();
    // Takes over causes that were found beside another base, or on other data, and fits them.
    bool take(const PredictionSearch &found);
    // The same for causes of another kind of search: base parameters of a model, the causes'
    // effects, for each the cause and its runners-up, and how many candidates were tried.
    bool take(const mk_model &values, const mk_effect_use *effects,
              const std::vector<std::vector<Candidate>> &ranked, int tried);
    // The same as run() from there.
    bool go_on();
    // Minus log likelihood of independent errors, with all causes and a penalty for their
    // parameters.
    double surprise() const { return penalised_nlml(best); }
    // What leaving data out says of all that is in this model against another one's, and by how
    // much the log likelihood of independent errors is better.
    Carried against(const PredictionSearch &other, double &gain) const;
    // Keeps those that carry over beside all others, or what does better in the place of one.
    void decide();
    // Keeps those of them that data which did not choose them confirm, and has their rivals in
    // their place.
    void claim(const HeldOut &held);
    // Asks causes that were found on other data, and no others.
    bool confirm(const PredictionSearch &found);
    // The base, and with all causes in their order.
    const RunFit &refitted() const { return refit; }
    const RunFit &extended() const { return best; }
    int tried() const { return most_tried; }
    bool has_cause(const Candidate &cause) const;
    // A cause, and those that nearly did as well when it was found.
    std::vector<Candidate> contenders(size_t cause) const;
    // What free runs say of how good a fit is and of its parameters, in place of what the
    // likelihood of all readings would.
    void judge(const RunFit &fit, Hypothesis &out) const;
    // Mean over joints of the squared error over that of the readings' noise, on data left out.
    double times_noise() const;
    // Mean over joints of the share of the refitted model's squared error that the causes close,
    // on data left out.
    double closed() const;

    std::vector<Carrier> causes;
    std::vector<Asked> suspects; // asked at the end, and not surely better

  private:
    Search &search;
    FreeRuns &runs;
    mk_model base;
    RunFit refit, best;
    double floor[MK_MAX_JOINTS] = {0.0, 0.0};
    int threads, most_tried = 0;
    size_t own_effects;              // of the base
    std::vector<Candidate> all;      // that could be added to the base
    std::vector<Candidate> hopeless; // starts that made predictions worse

    bool fit(const RunPoint &from, const mk_model &model, int iterations, int threads,
             RunFit &out) const; // `out.quadratic.stride` windows apart
    bool fit_added(const mk_model &model, const Candidate &cause, int iterations,
                   RunFit &out) const;
    bool leave_out(const std::vector<int> &wanted, RunFit &fit) const;
    Carried compare(const RunFit &with, const RunFit &without) const;
    void screen_linear(const std::vector<Candidate> &some, const RunFit &less,
                       std::vector<Asked> &out) const;
    void screen_group(const std::vector<Candidate> &group, const RunFit &less,
                      std::vector<Asked> &out) const;
    void screen_others(const std::vector<Candidate> &some, const RunFit &less,
                       std::vector<Asked> &out);
    std::vector<Asked> screen(const std::function<bool(const Candidate &)> &wanted);
    std::vector<RunFit> fit_in_full(const std::vector<Asked> &asked) const;
    double penalised_nlml(const RunFit &fit) const;
    bool plausible(const RunFit &fit) const;
    bool was_hopeless(const Candidate &cause) const;
    bool converge(RunFit &at) const;
    bool exchange(size_t count);
    void put_in_place(size_t cause, RunFit fit, std::vector<Candidate> next);
    bool reconsider_frictions();
    mk_model without(size_t cause) const;
    void face_rivals();
    std::vector<std::vector<Candidate>> runners_up; // by cause
    void leave_out_each();
    bool has_open_size(size_t cause) const;
    void leave_out_idle();
    void eliminate(size_t cause);
    size_t least_confirmed(const HeldOut &held) const;
};

// Score and information of a hypothesis as free runs over `runs` have them.
void judge_by_runs(const FreeRuns &runs, const RunPoint &point, const RunQuadraticModel &quadratic,
                   Hypothesis &out);

} // namespace mk
#endif
