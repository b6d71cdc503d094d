// The fit that all else starts from.
#ifndef MECHKIT_EXPLAIN_SEARCH_FIRST_FIT_HPP
#define MECHKIT_EXPLAIN_SEARCH_FIRST_FIT_HPP

#include <memory>
#include <vector>

#include "explain/evidence/carry_over.hpp"
#include "explain/search/search.hpp"
#include "mechkit/explain.h"

namespace mk
{

class FirstFit
{
  public:
    // `asked`: as given. `model`: the same; where values of it are unknown it is set to where the
    // fit starts. `start`: set to base parameters right to within a factor of some three; `usual`
    // refers to it, and its shooting interval is set here. All must outlive this.
    FirstFit(const mk_model &asked, mk_model &model, mk_model &start,
             const std::vector<const FitLog *> &training, const mk_explain_options &options,
             SearchOptions &usual);

    // Of the given values, unless one of others ends clearly nearer to the data. Fits what `logs`
    // are the rows of; the search that made it.
    std::unique_ptr<Search> run(const std::vector<const mk_log *> &logs);
    // The sharpness of dry friction's sign (search/sharpness.hpp) is fitted like other values of
    // the model, in `refit` and `start`, where the model is near its data with it. Further off it
    // bends to what else is missing.
    void adapt_sharpness(Search &search);
    // Of logs that move a rig little, a model that lacks something takes a mass to wherever the
    // rest bends to them, many times over. Where the fit is as far from what is given as that, it
    // is one that keeps the masses, unless data that are left out say that the other one was
    // learnt. `masses`: what `usual` refers to, set to nothing. True if so.
    bool keep_known_masses(Search &search, const Folds &folds, double window_s, MassRange &masses);

    // How far masses go in all that follows: what is given, the fit and, where that does not follow
    // its data, free runs agree about them. `masses`: as above.
    void agree_on_masses(Search &search, const Folds &folds, double window_s,
                         MassRange &masses) const;

    Hypothesis refit;
    bool fitted = false; // to the data at all

  private:
    const mk_model &asked;
    mk_model &model, &start;
    const std::vector<const FitLog *> &training;
    const mk_explain_options &options;
    SearchOptions &usual;

    std::unique_ptr<Search> fit(const std::vector<const mk_log *> &logs);
    std::unique_ptr<Search> fit_closer(std::unique_ptr<Search> search);
    bool passes_for_noise() const;
    bool any_unknown() const;
    bool starts_as_given() const;
    mk_model start_values(const std::vector<const mk_log *> &logs) const;
};

} // namespace mk
#endif
