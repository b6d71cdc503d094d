// What tools/bench/bench.py times of explain: a search among more or fewer hypotheses.
#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "bench_pendubot.hpp"
#include "explain/search/search.hpp"

namespace
{

// Four seconds of a pendubot whose second joint has friction that its model lacks.
struct Hunt {
    mk_model nominal = pendubot(P);
    mk::FitLog log;
    std::unique_ptr<mk::Search> search;
    mk::Hypothesis refit;
    std::vector<mk::Candidate> all;

    bool prepare()
    {
        constexpr int ROWS = 801;
        constexpr double COUNT = 2.0 * PI / 4000.0;
        std::vector<mk_model> truth = {nominal};
        if (mk_model_add_effect(&truth[0], "coulomb", 2, nullptr) != MK_OK)
            return false;
        const std::vector<double> x0 = {-PI / 2, 0, 0, 0};
        std::vector<double> t, u, held, x, q[2];
        for (int k = 0; k < ROWS; k++) {
            t.push_back(DT * k);
            u.push_back(1.5 * std::sin(6.0 * t.back()));
            held.insert(held.end(), {u.back(), 0.0});
        }
        mk_batch b = batch_of(truth, x0, DT, ROWS - 1, 1e-9, x);
        b.u = held.data();
        if (mk_simulate_batch(&b, nullptr) != MK_OK)
            return false;
        for (size_t k = 0; k < ROWS; k++)
            for (size_t j = 0; j < 2; j++)
                q[j].push_back(COUNT * std::round(x[4 * k + j] / COUNT));
        mk_record record = {};
        record.rows = ROWS;
        record.t = t.data();
        record.q[0] = q[0].data(), record.q[1] = q[1].data();
        record.u[0] = u.data();
        record.u_to_torque = 1.0;
        log = mk::fit_log(record, nominal, 0, ROWS);
        mk::SearchOptions options;
        options.given = &nominal;
        options.threads = 1;
        search = std::make_unique<mk::Search>(std::vector<const mk::FitLog *>{&log}, options);
        if (!search->refit(nominal, nullptr, refit))
            return false;
        // Backlash takes so much longer than all else that it would be all that is seen.
        for (const mk::Candidate &c :
             mk::candidates(refit.point.model, mk::data_range(nominal, {&log})))
            if (!mk::is_backlash(c.effect))
                all.push_back(c);
        return true;
    }
};

Hunt &hunt()
{
    static Hunt h;
    return h;
}

} // namespace

// How many there are to choose from; 0: failed.
EXPORT int bench_hypotheses_prepare(void)
{
    return hunt().prepare() ? (int)hunt().all.size() : 0;
}

// Tries `count` of them, evenly from the catalogue, and fits the best few in full.
EXPORT int bench_hypotheses(int count)
{
    Hunt &h = hunt();
    std::vector<mk::Candidate> some;
    for (size_t i = 0; i < (size_t)count; i++)
        some.push_back(h.all[i * h.all.size() / (size_t)count]);
    mk::ExtendOptions how;
    how.only = &some;
    h.search->extend(h.refit, how);
    return h.search->tried();
}
