// Which effects a model lacks: found one after another, and earlier ones reconsidered.
#ifndef MECHKIT_EXPLAIN_SEARCH_CAUSES_HPP
#define MECHKIT_EXPLAIN_SEARCH_CAUSES_HPP

#include <cmath>
#include <optional>

#include "explain/policy.hpp"
#include "explain/search/prediction_search.hpp"

namespace mk
{

// The best model without one of its causes, fitted.
struct Lack {
    double penalised_nlml, nlml; // as of Hypothesis and QuadraticModel
    mk_model model;
};

struct Round {
    std::vector<Hypothesis> ranked; // what competed for a place, the chosen one first
    std::optional<Lack> lack;       // if known
};

class CauseSearch
{
  public:
    CauseSearch(const mk_model &given, Search &search_in, const Hypothesis &refitted)
        : refit(refitted), best(refitted), model(given), search(search_in)
    {
    }
    void run();
    // From where run() has given up.
    void run_to_the_end();
    // Rivals near the best get the same care as the best before they are compared.
    void polish_rivals();
    // `best` without one of its causes.
    Lack without(size_t cause);
    // `best` without one of its causes, fitted from there; and that taken for the best.
    bool fit_without(size_t cause, Hypothesis &without);
    void shed(size_t cause, Hypothesis without);
    // What a model that follows its data leaves does not matter within a second of free run.
    // Contact leaves a little more, by the instants at which a simulation or a rig touches.
    bool follows(const Hypothesis &h) const;
    static bool matters(double process_noise) { return process_noise > policy::IMMATERIAL; }
    // With next to no process noise every reading speaks for itself, and the likelihood is what it
    // says. With more of it a model bends to its data, and whatever bends gains.
    static bool likelihood_counts(const Hypothesis &h);
    // Whether no cause of `best` is a nameless term.
    bool all_named() const;
    bool explained() const { return follows(best) && all_named(); }
    // Noise of a joint's readings. What a model that does not follow its data misses within a
    // shooting interval is none.
    double noise(int joint) const;
    // What improves predictions in place of what likelihood finds: the causes of that search, and
    // what it says of them.
    bool take_over(const PredictionSearch &other);
    // Gives it the causes of `best`, to be asked of data that are left out.
    bool hand_over(PredictionSearch &other) const;
    // Goes on from there by likelihood. False where all those causes together do not bring the
    // model so near to its data that likelihood counts.
    bool go_on(const PredictionSearch &found);
    // Puts simpler laws in the place of those with a parameter that the data leave open.
    void simplify();
    void unbend();
    // A rival takes the place of the only cause, as the simplest law that says the same.
    void let_lead(size_t rival);
    int tried() const { return most_tried; }

    // What leaving data out says of each cause of `best`; empty where it was not asked.
    std::vector<Carried> carried;
    // Causes that were asked beside those of `best` and do not carry over surely.
    std::vector<Asked> suspects;
    // Where even with so many causes the model is far from its data, and they gain less than this
    // (log likelihood a reading), no others are looked for; 0: they always are.
    size_t give_up_after = 1;
    double gives_up_below = 0.0;
    bool gives_up() const;
    // Whether looking for others will not help either.
    bool is_hopeless() const;
    Hypothesis refit;          // the given model, without a cause
    Hypothesis best;           // with all of them
    std::vector<Round> rounds; // one a cause of `best`, in its order

  private:
    const mk_model &model;
    Search &search;
    int most_tried = 0;
    double sharp_enough = (double)NAN; // penalised nlml of the last model that no other k helps
    bool near = false; // most of what is missing was found otherwise: what is left is small
    Hypothesis before; // the latest cause
    std::vector<Hypothesis> first; // what competed when there was no cause yet

    mk_model removed(size_t cause) const;
    bool remove(size_t cause, Hypothesis &without);

    bool idle_without_last();
    void drop_idle();
    void name_terms();
    bool gains_by_sharpness(Hypothesis &h);
    void adapt_sharpness();
    bool follow_with_sharpness(const mk_model &model, Hypothesis &out);
    void sharpen_friction();
    void find_sharpness();
    bool refit_with_sharpness();
    void lead_latest();
    void face_rivals_with_sharpness();
    bool fit_sharper_without(size_t cause, Hypothesis &sharper);
    bool sharper_without_law(Hypothesis &sharper, size_t &law);
    bool exchange_laws();
    bool take_place(size_t cause, const Candidate &law);
    void drop_idle_beside_sharpness(double step);
    void put_in_place(size_t cause, std::vector<Hypothesis> ranked, const Hypothesis &without);
    bool has_open_size(size_t cause) const;
    bool has_sure_size(size_t cause) const;
    static bool is_simpler(const Candidate &a, const Candidate &b);
    bool fit_simpler(size_t cause, const Candidate &start, Hypothesis &simpler);
    void say_simpler(size_t cause, Hypothesis simpler);
    bool likeliest_simpler(size_t cause, Hypothesis &likeliest);
    bool is_bent(size_t cause) const;
    size_t bent_count() const;
    bool has_open_shape(size_t cause) const;
    void face_rivals(size_t cause);
    void face_rivals_of(size_t count);
    bool has_cause(const Candidate &c) const;
    bool choose(std::vector<Hypothesis> &ranked, double needed);
    bool consider_backlash(std::vector<Hypothesis> &ranked, double needed);
    void consider_other_widths(Hypothesis &backlash);
    void consider_other_joint(std::vector<Hypothesis> &ranked);
    void consider_bristles(std::vector<Hypothesis> &ranked);
    void consider_own_places(std::vector<Hypothesis> &ranked);
    void forget_lacks();
    void warm_start(Hypothesis &rival);
    bool stands_alone(const Round &round) const;
    std::vector<Hypothesis> led_by(const Candidate &cause, std::vector<Hypothesis> ranked) const;
    bool may_add(size_t most) const;
    bool latest_leads_on() const;
    void look_further();
    bool is_done() const;
    bool find_next(std::vector<Hypothesis> &ranked);
    bool leaves_no_backlash(const Hypothesis &leader) const;
    static bool is_nearer(const Hypothesis &h, const Hypothesis &earlier);
    bool find_rare(ExtendOptions how, double needed, std::vector<Hypothesis> &ranked);
    void add_causes(size_t most);
    void try_runners_up();
    void reconsider();
    static Lack lack_of(const Hypothesis &h)
    {
        return {h.penalised_nlml, h.quadratic.nlml, h.point.model};
    }
};

} // namespace mk
#endif
