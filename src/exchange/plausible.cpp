// What a mapping gets wrong: changes to it are tried, and the one under which the columns go
// together is proposed.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "exchange/consistency.hpp"
#include "exchange/source.h"
#include "exchange/unit.h"
#include "mechkit/exchange.h"
#include "mechkit/number.h"

using namespace mk;

namespace
{

// The unit of a column of the log that a map makes.
const char *native_of(const mk_import_map &map, const char *name)
{
    return native_unit(
        quantity_of_joint_column(name, map.joint_linear, mk_plant(map.rig)->motor_joint));
}

struct Change {
    mk_import_map map;
    std::string what; // what is wrong if this change puts it right
};

using Log = std::unique_ptr<mk_log, decltype(&mk_log_free)>;

class Checker
{
  public:
    Checker(const mk_table *table, const char *path, const mk_import_map &map)
        : table_(table), path_(path), map_(map)
    {
    }
    std::vector<mk_import_finding> findings;
    void run();

  private:
    const mk_table *table_;
    const char *path_;
    mk_import_map map_; // with the changes found so far

    Log apply(const mk_import_map &map) const
    {
        mk_log *log = nullptr;
        if (mk_import_apply(table_, path_, &map, &log, nullptr) != MK_OK)
            log = nullptr;
        return Log(log, mk_log_free);
    }
    Consistency judge(const mk_import_map &map) const
    {
        Log log = apply(map);
        if (!log)
            return Consistency();
        mk_model rig;
        map_model(&map, &rig);
        return consistency(*log, rig);
    }
    void find(bool certain, const std::string &what, const mk_import_map *fixed);
    void check_time();
    void check_angles();
    void check_speeds();
    void check_motion();
};

// --- changes -------------------------------------------------------------------------------------

mk_import_column *column(mk_import_map &map, const char *to)
{
    return mk_import_map_find(&map, to);
}

class Changes
{
  public:
    explicit Changes(const mk_import_map &map) : map_(map) {}
    std::vector<Change> all;

    void flip(std::initializer_list<const char *> names, const char *what)
    {
        mk_import_map m = map_;
        bool any = false;
        for (const char *name : names)
            if (mk_import_column *c = column(m, name)) {
                c->sign = -c->sign;
                any = true;
            }
        if (any)
            all.push_back({m, what});
    }
    // The columns change places, what is done to them does not; or with all that is done to them.
    void swap(const char *one, const char *other, bool whole, const char *what)
    {
        swap({{one, other}}, whole, what);
    }
    void swap(std::initializer_list<std::pair<const char *, const char *>> pairs, bool whole,
              const char *what)
    {
        mk_import_map m = map_;
        bool any = false;
        for (const auto &pair : pairs) {
            mk_import_column *a = column(m, pair.first), *b = column(m, pair.second);
            if (!a || !b)
                continue;
            any = true;
            std::swap(a->from, b->from);
            std::swap(a->plus, b->plus);
            std::swap(a->minus, b->minus);
            if (whole) {
                std::swap(a->unit, b->unit);
                std::swap(a->sign, b->sign);
                std::swap(a->offset, b->offset);
            }
        }
        if (any)
            all.push_back({m, what});
    }
    void unit(std::initializer_list<const char *> names, const char *unit, const char *what)
    {
        mk_import_map m = map_;
        bool any = false;
        for (const char *name : names)
            if (mk_import_column *c = column(m, name)) {
                if (map_.joint_linear[name[strlen(name) - 1] == '2'])
                    continue;
                if (strcmp(*c->unit ? c->unit : native_of(map_, name), unit) == 0)
                    continue;
                snprintf(c->unit, sizeof c->unit, "%s", unit);
                any = true;
            }
        if (any)
            all.push_back({m, what});
    }
    void shift(const char *name, double by, const char *what)
    {
        mk_import_map m = map_;
        if (map_.joint_linear[name[strlen(name) - 1] == '2'])
            return;
        if (mk_import_column *c = column(m, name)) {
            c->offset = std::remainder(c->offset + by, 2.0 * M_PI);
            if (std::fabs(c->offset) < 1e-12)
                c->offset = 0.0;
            all.push_back({m, what});
        }
    }

  private:
    const mk_import_map &map_;
};

std::vector<Change> changes_of(const mk_import_map &map)
{
    Changes c(map);
    bool two = mk_plant(map.rig)->joints == 2;
    c.flip({"u", "u1", "tau", "tau1"}, "the command pushes the wrong way");
    c.flip({"q1"}, "q1 counts the wrong way");
    c.flip({"q1", "dq1"}, "q1 counts the wrong way");
    c.unit({"q1", "q2"}, "deg", "the angles are in degrees");
    c.unit({"q1", "q2"}, "rad", "the angles are in radians");
    c.unit({"q1", "q2"}, "rev", "the angles are in revolutions");
    for (double by : {M_PI / 2, -M_PI / 2, M_PI})
        c.shift("q1", by, "q1 is counted from elsewhere");
    c.flip({"dq1"}, "dq1 runs against the slope of q1");
    c.flip({"dq2"}, "dq2 runs against the slope of q2");
    for (const char *unit : {"deg/s", "rad/s", "rpm", "rev/s"})
        c.unit({"dq1", "dq2"}, unit, "the speeds are in another unit");
    c.swap("q1", "u", false, "q1 and the command are swapped");
    c.swap("q1", "tau", false, "q1 and the command are swapped");
    c.swap("q1", "tau1", false, "q1 and the command are swapped");
    if (!two)
        return std::move(c.all);
    c.flip({"q2"}, "q2 counts the wrong way");
    c.flip({"q2", "dq2"}, "q2 counts the wrong way");
    c.swap("q1", "q2", false, "the joints are swapped");
    c.swap("dq1", "dq2", false, "the speeds are swapped");
    for (bool whole : {false, true}) {
        c.swap({{"q1", "q2"}, {"dq1", "dq2"}}, whole, "the joints are swapped");
        c.swap({{"q1", "q2"}, {"dq1", "dq2"}, {"tau1", "tau2"}, {"u1", "u2"}}, whole,
               "the joints are swapped, their commands too");
    }
    c.swap({{"tau1", "tau2"}, {"u1", "u2"}}, false, "the commands of the joints are swapped");
    c.swap("q2", "u", false, "q2 and the command are swapped");
    c.swap("q2", "tau1", false, "q2 and the command are swapped");
    c.unit({"q1"}, "deg", "q1 is in degrees");
    c.unit({"q2"}, "deg", "q2 is in degrees");
    c.unit({"q1"}, "rad", "q1 is in radians");
    c.unit({"q2"}, "rad", "q2 is in radians");
    for (double by : {M_PI, M_PI / 2, -M_PI / 2})
        c.shift("q2", by, "q2 is counted from elsewhere");
    c.flip({"u2", "tau2"}, "the torque on joint 2 pushes the wrong way");
    c.flip({"q1", "dq1", "q2", "dq2"}, "both joints count the wrong way");
    return std::move(c.all);
}

// "[q1] sign = -1, [q2] column = theta": what differs in `now`.
std::string difference(const mk_import_map &before, const mk_import_map &now)
{
    std::string out;
    auto put = [&](const mk_import_column &c, const char *key, const std::string &value) {
        out += (out.empty() ? "[" : ", [") + std::string(c.to) + "] " + key + " = " + value;
    };
    auto number = [](double value) {
        char text[MK_NUMBER_MAX];
        mk_format_double(text, value);
        return std::string(text);
    };
    for (int i = 0; i < now.count; i++) {
        const mk_import_column &a = before.column[i], &b = now.column[i];
        if (strcmp(a.from, b.from) != 0)
            put(b, "column", b.from);
        if (strcmp(a.plus, b.plus) != 0)
            put(b, "plus", b.plus);
        if (strcmp(a.minus, b.minus) != 0)
            put(b, "minus", b.minus);
        if (strcmp(a.unit, b.unit) != 0)
            put(b, "unit", *b.unit ? b.unit : native_of(now, b.to));
        if (a.sign != b.sign)
            put(b, "sign", number(b.sign));
        if (a.offset != b.offset)
            put(b, "offset", number(b.offset));
    }
    return out;
}

// --- checks --------------------------------------------------------------------------------------

void Checker::find(bool certain, const std::string &what, const mk_import_map *fixed)
{
    mk_import_finding f = {};
    f.certain = certain;
    snprintf(f.what, sizeof f.what, "%s", what.c_str());
    f.fixed = map_;
    if (fixed) {
        f.fixed = *fixed;
        snprintf(f.proposal, sizeof f.proposal, "%s", difference(map_, *fixed).c_str());
        map_ = *fixed;
    }
    findings.push_back(f);
}

// Labs sample at 20 Hz to 20 kHz: between the units of time lie factors of a thousand.
void Checker::check_time()
{
    Log log = apply(map_);
    if (!log || log->rows < 3)
        return;
    double dt = sample_time(*log);
    if (dt >= 5e-5 && dt <= 0.11)
        return;
    char what[200];
    snprintf(what, sizeof what, "samples come every %.3g s: the unit of time is another", dt);
    for (const char *unit : {"s", "ms", "us", "ns"}) {
        mk_import_map m = map_;
        snprintf(column(m, "t")->unit, sizeof m.column[0].unit, "%s", unit);
        Log other = apply(m);
        double then = other ? sample_time(*other) : 0.0;
        if (then >= 2e-4 && then <= 0.05)
            return find(true, what, &m);
    }
    find(true, what, nullptr);
}

// No wheel turns a hundred thousand times in a run: such numbers are something else, or garbage.
void Checker::check_angles()
{
    const double most = 1e6; // rad, m
    Log log = apply(map_);
    for (const char *name : {"q1", "q2"}) {
        const double *q = log ? mk_log_get(log.get(), name) : nullptr;
        double reach = 0.0;
        for (size_t r = 0; q && r < log->rows; r++)
            reach = std::fmax(reach, std::fabs(q[r])); // fmax passes a NaN over
        if (reach <= most)
            continue;
        char what[120];
        snprintf(what, sizeof what, "%s reaches %.3g %s: that is no position of a rig", name, reach,
                 native_of(map_, name));
        find(true, what, nullptr);
    }
}

// Speeds that still run against their angles when the angles are right.
void Checker::check_speeds()
{
    for (int j = 0; j < 2; j++) {
        Log log = apply(map_);
        if (!log || !speed_is_against(*log, j))
            continue;
        const std::string name = j ? "dq2" : "dq1";
        mk_import_map m = map_;
        column(m, name.c_str())->sign *= -1.0;
        find(true, name + " runs against the slope of " + name.substr(1), &m);
    }
}

// How much of the accelerations (squared) may be left where a change is proposed, and how much less
// than without it; where it is certain. Of 1120 pieces of 35 measured logs (1.6 s and longer) none
// has a change that is certain, with the measured or the commanded torque; the nearest leaves 0.10.
constexpr double LEFT_IF_LIKELY = 0.2, LEFT_IF_CERTAIN = 0.08;
constexpr double SHARE_IF_LIKELY = 0.33, SHARE_IF_CERTAIN = 0.2;
// So little is left that no change is called for.
constexpr double NOTHING_LEFT = 0.02;
// Fits as near each other are alike: a tenth, or a hundredth of the accelerations.
constexpr double ALIKE = 1.1, ALIKE_LEFT = 0.01;

// What speaks against a map beside the fit.
int doubts(const Consistency &c)
{
    return !c.hangs + !c.counts + c.astray;
}

bool as_good(const Consistency &a, const Consistency &b)
{
    return a.error < ALIKE * b.error + ALIKE_LEFT;
}

bool better(const Consistency &a, const Consistency &b)
{
    // Speeds need no model: what makes them slopes comes first. Of fits alike the one with fewer
    // doubts, then the first.
    if (a.astray != b.astray)
        return a.astray < b.astray;
    if (as_good(a, b) && as_good(b, a) && doubts(a) != doubts(b))
        return doubts(a) < doubts(b);
    return !(as_good(a, b) && as_good(b, a)) && a.error < b.error;
}

// Of what is left without a change, what is beyond doubt: of parameters of any sign, unless one is
// below zero by more than its standard error allows.
double certainly_left(const Consistency &c)
{
    return c.wrong_sign >= 0 ? c.error : std::fmin(c.error, c.free_error);
}

// How sure it is that a change is called for.
enum class Call { none, likely, certain };

Call call_for(const Consistency &as_is, const Consistency &changed)
{
    const double share = changed.error / std::fmax(as_is.error, 1e-12);
    const bool fewer = doubts(changed) < doubts(as_is) && as_good(changed, as_is);
    if (changed.astray < as_is.astray || (fewer && changed.counts && !as_is.counts))
        return Call::certain;
    if (as_is.error > NOTHING_LEFT) {
        if (changed.error < LEFT_IF_CERTAIN &&
            changed.error < SHARE_IF_CERTAIN * certainly_left(as_is))
            return Call::certain;
        const bool much = changed.error > LEFT_IF_CERTAIN;
        if (changed.error < LEFT_IF_LIKELY && share < (much ? SHARE_IF_CERTAIN : SHARE_IF_LIKELY))
            return Call::likely;
    }
    return fewer && changed.error < LEFT_IF_LIKELY ? Call::likely : Call::none;
}

std::string complaint(const mk_import_map &map, const Consistency &as_is,
                      const Consistency &changed, const std::string &what)
{
    const char *rig = mk_plant(map.rig)->name;
    char text[256];
    if (changed.astray < as_is.astray)
        snprintf(text, sizeof text, "a speed is not the slope of its angle: %s", what.c_str());
    else if (changed.counts && !as_is.counts)
        snprintf(text, sizeof text, "no encoder has steps like these: %s", what.c_str());
    else if (changed.hangs && !as_is.hangs)
        snprintf(text, sizeof text, "it stands still at the start where no %s hangs: %s", rig,
                 what.c_str());
    else
        snprintf(text, sizeof text,
                 "%s: as it is, no %s leaves less than %.0f %% of the accelerations unexplained; "
                 "so changed, one leaves %.2g %%",
                 what.c_str(), rig, 100.0 * std::fmin(1.0, as_is.error), 100.0 * changed.error);
    return text;
}

void Checker::check_motion()
{
    Consistency as_is = judge(map_);
    // Where nothing is left and nothing else speaks against it, no change is called for.
    if (!as_is.known || (as_is.error <= NOTHING_LEFT && doubts(as_is) == 0))
        return;
    Consistency best;
    best.error = HUGE_VAL;
    best.astray = MK_MAX_JOINTS + 1;
    const Change *fix = nullptr;
    std::vector<Change> changes = changes_of(map_);
    for (const Change &change : changes) {
        Consistency c = judge(change.map);
        if (c.known && doubts(c) <= doubts(as_is) && better(c, best)) {
            best = c;
            fix = &change;
        }
    }
    const Call call = fix ? call_for(as_is, best) : Call::none;
    if (call != Call::none)
        find(call == Call::certain, complaint(map_, as_is, best, fix->what), &fix->map);
}

void Checker::run()
{
    check_time();
    check_angles();
    check_motion();
    check_speeds();
}

} // namespace

int mk_import_check(const mk_table *table, const char *path, const mk_import_map *map,
                    mk_import_finding *out)
try {
    Checker checker(table, path, *map);
    checker.run();
    int n = 0;
    for (const mk_import_finding &f : checker.findings)
        if (n < MK_IMPORT_FINDINGS)
            out[n++] = f;
    return n;
} catch (const std::bad_alloc &) {
    return 0;
}
