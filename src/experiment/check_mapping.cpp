// Signs, units and places of a log's columns: what the textbook says, which knows any rig of the
// kind, and what the model predicts, which is of this one.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "experiment/findings.hpp"
#include "mechkit/exchange.h"
#include "sim/predict.h"

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
// A command is felt in proportion: of the sign that is right even a model that misses something
// leaves less than of the other one. Of the error as it is, what the other sign must leave for it
// to be doubted, and to be wrong for certain where it then predicts GOOD; and what a change of two
// columns must leave of the error that a change of one of them leaves.
constexpr double OTHER_SIGN = 0.5, SURELY_OTHER = 0.25, GOOD = 0.05, MORE_COLUMNS = 0.7;

using Log = std::unique_ptr<mk_log, decltype(&mk_log_free)>;
using Table = std::unique_ptr<mk_table, decltype(&mk_table_free)>;

// Squared errors of a joint, rad^2 or m^2: of the model's predictions, and of constant speeds.
struct JointErrors {
    double model, even;
};

// Mean over the joints whose speeds do not stay as they are. 0: nothing moves, or nothing can be
// said. `errors`: sums by joint.
double misfit(const mk_model &model, const mk_log &log, JointErrors errors[MK_MAX_JOINTS])
{
    mk_predict_options o = {};
    o.window_s = WINDOW_S;
    mk_predict_figures figures;
    mk_log *out = nullptr;
    if (mk_predict_angles(&model, &log, &o, &out, &figures, nullptr, nullptr) != MK_OK)
        return 0.0;
    const Log made(out, mk_log_free);
    const double *t = mk_log_get(&log, "t"), *window = mk_log_get(out, "window");
    double sum = 0.0, n = 0.0;
    std::fill_n(errors, MK_MAX_JOINTS, JointErrors{0.0, 0.0});
    for (int j = 0; j < mk_model_joints(&model) && window; j++) {
        const double *y = mk_log_get(&log, mk_log_angle(j)), *q = mk_log_get(out, mk_log_angle(j));
        const double *v = mk_log_get(out, mk_log_speed(j)), noise = 3.0 * mk_model_count(&model, j);
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
        errors[j] = {off, even};
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

void flip(mk_import_map &map, const char *name)
{
    if (mk_import_column *column = mk_import_map_find(&map, name))
        column->sign = -column->sign;
}

struct PlaceChange {
    bool q1, q2, swap;
    const char *what, *change;

    mk_import_map made(mk_import_map map) const
    {
        if (q1)
            flip(map, "q1");
        if (q2)
            flip(map, "q2");
        if (swap)
            std::swap(mk_import_map_find(&map, "q1")->from, mk_import_map_find(&map, "q2")->from);
        return map;
    }
};

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

    JointErrors own[MK_MAX_JOINTS] = {};

    double misfit_of(const mk_import_map &map, JointErrors errors[MK_MAX_JOINTS]) const
    {
        mk_log *log = nullptr;
        if (mk_import_apply(table.get(), c.log.path, &map, &log, nullptr) != MK_OK)
            return HUGE_VAL;
        const Log owned(log, mk_log_free);
        return misfit(c.model, *log, errors);
    }
    double misfit_of(const mk_import_map &map) const
    {
        JointErrors errors[MK_MAX_JOINTS];
        return misfit_of(map, errors);
    }
    double of_own_errors(const PlaceChange &change) const;
    std::vector<const char *> other_sign; // of commands: whose leaves least,
    double others_leave = HUGE_VAL;       // and how much
    void turn_commands();
    bool ask_textbook();
    bool ask_commands();
    bool textbook_refuses(const mk_import_map &changed) const;
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

// What the textbook finds goes by any rig of the kind: the model has to agree, and must not know
// better. True if it does.
bool Mapping::ask_textbook()
{
    mk_import_finding findings[MK_IMPORT_FINDINGS];
    bool said = false;
    const int count = mk_import_check(table.get(), c.log.path, &itself, findings);
    for (int i = 0; i < count; i++) {
        const mk_import_finding &f = findings[i];
        const double most = f.certain ? CONTRADICTS : AGREES;
        if (f.proposal[0] && now > 0.0) {
            const double then = misfit_of(f.fixed);
            if (!(then < most * now) || others_leave < AGREES * then)
                continue;
        }
        say(f.certain, f.what, f.proposal);
        said = true;
    }
    return said;
}

// Commands with the other sign: which of them, one or all, leave least.
void Mapping::turn_commands()
{
    std::vector<const char *> driven;
    for (const char *name : {"u", "tau", "u1", "tau1", "u2", "tau2"}) {
        mk_import_map map = itself;
        if (mk_import_map_find(&map, name))
            driven.push_back(name);
    }
    std::vector<std::vector<const char *>> choices;
    for (const char *name : driven)
        choices.push_back({name});
    if (driven.size() > 1)
        choices.push_back(driven);
    for (const std::vector<const char *> &choice : choices) {
        mk_import_map map = itself;
        for (const char *name : choice)
            flip(map, name);
        const double then = misfit_of(map);
        if (then > 0.0 && then < (choice.size() > 1 ? MORE_COLUMNS : 1.0) * others_leave) {
            others_leave = then;
            other_sign = choice;
        }
    }
}

// Whether no rig of the kind can move as the log says with a change of its columns, while one can
// as they are. Then it is the values of the model that are wrong: they may be off by orders of
// magnitude, which is what a log is identified for.
bool Mapping::textbook_refuses(const mk_import_map &changed) const
{
    mk_import_finding findings[MK_IMPORT_FINDINGS];
    return mk_import_check(table.get(), c.log.path, &itself, findings) == 0 &&
           mk_import_check(table.get(), c.log.path, &changed, findings) > 0;
}

// True if the other sign of a command leaves clearly less, or would if the model were right.
bool Mapping::ask_commands()
{
    if (!(others_leave < std::fmin(OTHER_SIGN * now, LIKELY)))
        return false;
    mk_import_map turned = itself;
    for (const char *name : other_sign)
        flip(turned, name);
    if (textbook_refuses(turned))
        return true;
    std::string names, change;
    for (const char *name : other_sign) {
        names += (names.empty() ? "" : " and ") + std::string(name);
        change += (change.empty() ? "" : ", ") + text("[%s] sign = -1", name);
    }
    say(others_leave < std::fmin(SURELY_OTHER * now, GOOD),
        text("%s %s the wrong way: with the other sign the model's predictions over %g s are off "
             "by %.2g %% of the motion (squared), as it is by %.2g %%",
             names.c_str(), other_sign.size() > 1 ? "push" : "pushes", WINDOW_S,
             100.0 * others_leave, 100.0 * std::fmin(now, 1.0)),
        change);
    return true;
}

// Speeds at the beginning of a window are what the model takes them for. One that is wrong takes
// them for anything, and all constant speeds are then far off: what it leaves counts by the error
// that they have of the columns as they are.
double Mapping::of_own_errors(const PlaceChange &change) const
{
    JointErrors errors[MK_MAX_JOINTS] = {};
    if (!(misfit_of(change.made(itself), errors) > 0.0))
        return 0.0;
    double sum = 0.0, n = 0.0;
    for (int j = 0; j < mk_model_joints(&c.model); j++) {
        const double even = own[change.swap ? 1 - j : j].even;
        if (errors[j].even > 0.0 && even > 0.0)
            sum += std::fmin(errors[j].model / even, HOPELESS), n++;
    }
    return n > 0.0 ? sum / n : 0.0;
}

// Where nothing else is found: signs and places of angles under which a model predicts that knows
// nothing of the data as they are.
void Mapping::ask_model()
{
    static const PlaceChange changes[] = {
        {true, false, false, "q1 counts the wrong way", "[q1] sign = -1"},
        {false, true, false, "q2 counts the wrong way", "[q2] sign = -1"},
        {true, true, false, "both angles count the wrong way", "[q1] sign = -1, [q2] sign = -1"},
        {false, false, true, "the joints are swapped", "[q1] column = q2, [q2] column = q1"},
    };
    const PlaceChange *best = nullptr;
    double least = LIKELY;
    for (const PlaceChange &change : changes) {
        if (!(now > KNOWS_NOTHING) || (mk_model_joints(&c.model) < 2 && (change.q2 || change.swap)))
            continue;
        const double then = std::fmax(misfit_of(change.made(itself)), of_own_errors(change));
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
    now = misfit_of(itself, own);
    if (now > 0.0)
        turn_commands();
    if (!ask_textbook() && !ask_commands())
        ask_model();
}

} // namespace

void check_mapping(const CheckedLog &log, Findings &out)
{
    if (log.record.u[0])
        Mapping(log, out).check();
}

} // namespace mk
