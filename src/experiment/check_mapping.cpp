// Signs, units and places of a log's columns: what the textbook says, which knows any rig of the
// kind, and what the model predicts, which is of this one.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>

#include "experiment/findings.hpp"
#include "mechkit/exchange.h"
#include "mechkit/sim.h"

namespace mk
{

namespace
{

constexpr double TURN = 6.283185307179586; // rad
constexpr double WINDOW_S = 0.2;           // of a prediction
constexpr size_t MOST_ROWS = 5000;         // that are looked at
constexpr double MOST_S = 20.0;
constexpr double HOPELESS = 4.0; // squared error that counts, of constant speed's

// Squared error of the model's predictions over that of constant speeds. Above KNOWS_NOTHING the
// model is as good as none; a change of the columns is proposed where it leaves LIKELY, and certain
// where it leaves next to nothing. Of what the textbook proposes the model must take away half.
constexpr double KNOWS_NOTHING = 0.7, LIKELY = 0.35, CERTAIN = 0.1, AGREES = 0.5;
// What the textbook holds for certain goes unless the model says the opposite.
constexpr double CONTRADICTS = 1.1;

const char *const angles[MK_MAX_JOINTS] = {"q1", "q2"};
const char *const speeds[MK_MAX_JOINTS] = {"dq1", "dq2"};

using Log = std::unique_ptr<mk_log, decltype(&mk_log_free)>;
using Table = std::unique_ptr<mk_table, decltype(&mk_table_free)>;

// Mean over the joints whose speeds do not stay as they are. 0: nothing moves, or nothing can be
// said.
double misfit(const mk_model &model, const mk_log &log)
{
    mk_predict_options o = {};
    o.window_s = WINDOW_S;
    mk_predict_figures figures;
    mk_log *out = nullptr;
    if (mk_predict(&model, &log, &o, &out, &figures, nullptr, nullptr) != MK_OK)
        return 0.0;
    const Log made(out, mk_log_free);
    const double *t = mk_log_get(&log, "t"), *window = mk_log_get(out, "window");
    double sum = 0.0, n = 0.0;
    for (int j = 0; j < mk_model_joints(&model) && window; j++) {
        const double *y = mk_log_get(&log, angles[j]), *q = mk_log_get(out, angles[j]);
        const double *v = mk_log_get(out, speeds[j]), noise = 3.0 * mk_model_count(&model, j);
        double off = 0.0, even = 0.0, count = 0.0;
        for (size_t k = 0, first = 0; k < log.rows; k++) {
            if (window[k] != window[first])
                first = k;
            const double stay = y[k] - (q[first] + v[first] * (t[k] - t[first]));
            if (!std::isfinite(stay))
                continue;
            off += std::isfinite(q[k]) ? (y[k] - q[k]) * (y[k] - q[k]) : HOPELESS * stay * stay;
            even += stay * stay;
            count++;
        }
        if (even > noise * noise * count) {
            sum += std::fmin(off / even, HOPELESS);
            n++;
        }
    }
    return n > 0.0 ? sum / n : 0.0;
}

// The log's own columns as a mapping for `import` calls them.
mk_import_map map_itself(const CheckedLog &c)
{
    static const char *const names[] = {"t", "q1", "q2", "u", "tau", "u1", "u2", "tau1", "tau2"};
    mk_import_map map = {};
    map.rig = mk_plant(c.model.plant)->kind;
    map.no_input = !c.record.u[0];
    for (const char *name : names) {
        if (!mk_log_get(&c.log, name) || (strcmp(name, "q2") == 0 && mk_model_joints(&c.model) < 2))
            continue;
        mk_import_column &column = map.column[map.count++];
        column.sign = 1.0;
        snprintf(column.to, sizeof column.to, "%s", name);
        snprintf(column.from, sizeof column.from, "%s", name);
    }
    return map;
}

class Mapping
{
  public:
    Mapping(const CheckedLog &log_in, Findings &out_in)
        : c(log_in), out(out_in), table(nullptr, mk_table_free), itself(map_itself(log_in))
    {
    }
    void check();

  private:
    const CheckedLog &c;
    Findings &out;
    Table table;
    mk_import_map itself;
    double now = 0.0; // misfit of the data as they are

    double misfit_of(const mk_import_map &map) const
    {
        mk_log *log = nullptr;
        if (mk_import_apply(table.get(), c.log.path, &map, &log, nullptr) != MK_OK)
            return HUGE_VAL;
        const Log owned(log, mk_log_free);
        return misfit(c.model, *log);
    }
    bool ask_textbook();
    void ask_model();
    void say(bool certain, const std::string &what, const std::string &change);
};

void Mapping::say(bool certain, const std::string &what, const std::string &change)
{
    const std::string remedy =
        change.empty() ? "look at the column" : "if so, mechkit import --map with " + change;
    if (certain)
        out.fatal(what, remedy);
    else
        out.doubt(what, remedy);
}

// What the textbook finds goes by any rig of the kind: the model has to agree. True if it does.
bool Mapping::ask_textbook()
{
    mk_import_finding findings[MK_IMPORT_FINDINGS];
    bool said = false;
    const int count = mk_import_check(table.get(), c.log.path, &itself, findings);
    for (int i = 0; i < count; i++) {
        const mk_import_finding &f = findings[i];
        const double most = f.certain ? CONTRADICTS : AGREES;
        if (f.proposal[0] && now > 0.0 && !(misfit_of(f.fixed) < most * now))
            continue;
        say(f.certain, f.what, f.proposal);
        said = true;
    }
    return said;
}

void flip(mk_import_map &map, const char *name)
{
    if (mk_import_column *column = mk_import_map_find(&map, name))
        column->sign = -column->sign;
}

struct SignChange {
    bool u, q1, q2, swap;
    const char *what, *change;

    mk_import_map made(mk_import_map map) const
    {
        for (const char *name : {"u", "tau", "u1", "tau1"})
            if (u)
                flip(map, name);
        if (q1)
            flip(map, "q1");
        if (q2)
            flip(map, "q2");
        if (swap)
            std::swap(mk_import_map_find(&map, "q1")->from, mk_import_map_find(&map, "q2")->from);
        return map;
    }
};

// Where the textbook finds nothing: signs and places of columns under which a model predicts that
// knows nothing of the data as they are.
void Mapping::ask_model()
{
    static const SignChange changes[] = {
        {true, false, false, false, "the command pushes the wrong way", "[u] sign = -1"},
        {false, true, false, false, "q1 counts the wrong way", "[q1] sign = -1"},
        {false, false, true, false, "q2 counts the wrong way", "[q2] sign = -1"},
        {false, true, true, false, "both angles count the wrong way",
         "[q1] sign = -1, [q2] sign = -1"},
        {false, false, false, true, "the joints are swapped", "[q1] column = q2, [q2] column = q1"},
    };
    const SignChange *best = nullptr;
    double least = LIKELY;
    for (const SignChange &change : changes) {
        if (!(now > KNOWS_NOTHING) || (mk_model_joints(&c.model) < 2 && (change.q2 || change.swap)))
            continue;
        const double then = misfit_of(change.made(itself));
        if (then < least) {
            least = then;
            best = &change;
        }
    }
    if (best)
        say(least < CERTAIN,
            text("%s: as they are, the model's predictions over %g s are off by %.0f %% of the "
                 "motion (squared); so changed, by %.2g %%",
                 best->what, WINDOW_S, 100.0 * std::fmin(now, 1.0), 100.0 * least),
            best->change);
}

void Mapping::check()
{
    mk_log beginning = c.log;
    const double *t = c.record.t;
    beginning.rows = std::min(beginning.rows, MOST_ROWS);
    while (beginning.rows > 2 && t[beginning.rows - 1] - t[0] > MOST_S)
        beginning.rows--;
    mk_table *made = nullptr;
    if (mk_table_from_log(&beginning, nullptr, 0.0, &made, nullptr) != MK_OK)
        return;
    table.reset(made);
    now = misfit_of(itself);
    if (!ask_textbook())
        ask_model();
}

} // namespace

void check_mapping(const CheckedLog &log, Findings &out)
{
    if (log.record.u[0])
        Mapping(log, out).check();
}

} // namespace mk
