// Which effects a model lacks: found one after another, and earlier ones reconsidered.
#ifndef MECHKIT_EXPLAIN_CAUSES_HPP
#define MECHKIT_EXPLAIN_CAUSES_HPP

#include "explain/search.hpp"

namespace mk
{

constexpr double ENOUGH = 12.0; // log likelihood (after penalty) a cause must gain to be named
constexpr double AGAIN = 20.0;  // the same for a second cause and further ones

struct Round {
    std::vector<Hypothesis> field; // what competed for a place, the chosen one first
};

class CauseSearch
{
  public:
    CauseSearch(const mk_model &given, Search &search_in, const Hypothesis &refitted)
        : refit(refitted), best(refitted), model(given), search(search_in)
    {
    }
    void run();
    // Rivals near the best get the same care as the best before they are compared.
    void polish_rivals();
    // `best` without one of its causes, refitted.
    bool remove(size_t cause, Hypothesis &without);
    // What a model that follows its data leaves does not matter within a second of free run.
    // Contact leaves a little more, by the instants at which a simulation or a rig touches.
    bool follows(const Hypothesis &h) const;
    static bool matters(double drift);
    int tried() const { return most_tried; }

    Hypothesis refit;          // the given model, without a cause
    Hypothesis best;           // with all of them
    std::vector<Round> rounds; // one a cause of `best`, in its order

  private:
    const mk_model &model;
    Search &search;
    int most_tried = 0;

    bool idle_without_last(const Hypothesis &before);
    void reconsider();
};

} // namespace mk
#endif
