// Cases with hidden effects by the dozen, and what explain says to them: hits, false alarms, gains,
// as a table by effect and by rig. `--write DIR` writes the cases as files instead.
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>

#include "base/parallel.hpp"
#include "mechkit/explain.h"
#include "support/cases.hpp"

namespace
{

struct Result {
    std::string rig, kind, hidden, said;
    bool failed = false, weak = false, first = false, rival = false, all = false, alarm = false,
         exact = false, unknown = false, claims = false;
    double closed = 0.0, error = NAN, seconds = 0.0;
    int there = 0, found = 0, named = 0, right = 0; // of several effects; of the causes named
    std::vector<std::pair<double, bool>> stated; // confidence of a named cause, and whether right
    std::vector<double> base, effect;            // parameters' errors, in their standard errors
};

std::string place(const std::string &name, int joint)
{
    return joint ? name + "@" + std::to_string(joint) : name;
}

bool among(const std::vector<truth::Name> &names, const char *effect, int joint)
{
    return std::any_of(names.begin(), names.end(), [&](const truth::Name &n) {
        return n.effect == effect && (n.joint == 0 || n.joint == joint);
    });
}

// What a report claims of its own certainty, beside the truth.
void check_stated(const truth::Case &c, const mk_explanation &e, Result &r)
{
    for (int i = 0; r.claims && i < e.cause_count; i++) {
        const mk_cause &m = e.cause[i];
        bool right = std::any_of(c.right.begin(), c.right.end(), [&](const auto &names) {
            return among(names, m.effect->name, m.joint);
        });
        r.stated.emplace_back(m.confidence, right);
        for (const truth::Effect &t : c.rig.effects)
            for (int k = 0;
                 t.name == m.effect->name && t.joint == m.joint && k < m.effect->parameter_count;
                 k++) {
                auto it = t.value.find(m.effect->parameter[k].name);
                if (it != t.value.end() && m.std_error[k] > 0.0)
                    r.effect.push_back((m.value[k] - it->second) / m.std_error[k]);
            }
    }
    const bool clean = c.right.empty() && c.kind != "off";
    if (clean ? r.alarm : !r.all || !r.claims)
        return;
    for (size_t i = 0; i < c.rig.p.size(); i++)
        if (e.std_error[i] > 0.0)
            r.base.push_back((mk_model_parameter(&e.extended, (int)i) - c.rig.p[i]) /
                             e.std_error[i]);
}

// Of several effects those that are named, and of the causes named those that are there.
void judge_several(const truth::Case &c, const mk_explanation &e, Result &r)
{
    r.there = (int)c.right.size();
    r.claims = e.verdict == MK_VERDICT_EFFECT || e.verdict == MK_VERDICT_PARTIAL;
    r.named = r.claims ? e.cause_count - e.piece_count : 0;
    const auto is_cause = [&](const std::vector<truth::Name> &names, int i) {
        return among(names, e.cause[i].effect->name, e.cause[i].joint);
    };
    for (const auto &names : c.right)
        for (int i = 0; i < r.named; i++)
            if (is_cause(names, i)) {
                r.found++;
                break;
            }
    for (int i = 0; i < r.named; i++) {
        const bool right = std::any_of(c.right.begin(), c.right.end(),
                                       [&](const auto &names) { return is_cause(names, i); });
        r.right += right;
        r.first = r.first || (i == 0 && right);
    }
}

void judge(const truth::Case &c, const mk_explanation &e, Result &r)
{
    for (int i = 0; i < e.cause_count; i++)
        r.said += (i ? " + " : "") + place(e.cause[i].effect->name, e.cause[i].joint);
    if (r.said.empty() || e.verdict == MK_VERDICT_UNKNOWN)
        r.said = mk_verdict_name(e.verdict) +
                 (e.structure[0] ? std::string(" (") + e.structure + ")" : std::string());
    const bool claims = r.claims = e.verdict == MK_VERDICT_EFFECT;
    r.unknown = e.verdict == MK_VERDICT_UNKNOWN;
    r.alarm = claims || r.unknown;
    r.exact = c.kind == mk_verdict_name(e.verdict);
    auto named = [&](const std::vector<truth::Name> &names) {
        for (int i = 0; claims && i < e.cause_count; i++)
            if (among(names, e.cause[i].effect->name, e.cause[i].joint))
                return true;
        return false;
    };
    r.all = !c.right.empty();
    for (const auto &names : c.right) {
        r.first = r.first || (claims && among(names, e.cause[0].effect->name, e.cause[0].joint));
        r.rival = r.rival || named(names);
        r.all = r.all && named(names);
        for (int i = 0; i < e.rival_count; i++)
            r.rival = r.rival || (!e.rival[i].distinguishable &&
                                  among(names, e.rival[i].effect->name, e.rival[i].joint));
    }
    // Too small to see: the refitted model predicts nearly as well as readings are read.
    double worst = 0.0;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        if (e.floor[j] > 0.0)
            worst = std::max(worst, e.refitted[j] / e.floor[j]);
    r.weak = worst < 2.0;
    r.closed = std::max(-1.0, e.closed);
    if (r.first) {
        const truth::Effect &t = c.rig.effects[0];
        const mk_cause &m = e.cause[0];
        auto it = t.value.find(m.effect->parameter[0].name);
        if (t.name == m.effect->name && it != t.value.end())
            r.error = std::fabs(m.value[0] / it->second - 1.0);
    }
    if (c.kind == "several")
        judge_several(c, e, r);
    else
        check_stated(c, e, r);
    r.seconds = e.seconds;
}

Result play(const truth::Wish &wish, int threads)
{
    Result r;
    try {
        truth::Case c = truth::make_case(wish);
        r.rig = c.rig.kind;
        r.kind = c.kind;
        for (const truth::Effect &e : c.rig.effects) {
            r.hidden += (r.hidden.empty() ? "" : " + ") + place(e.name, e.joint);
            char value[64];
            snprintf(value, sizeof value, " %.3g", e.value.begin()->second);
            r.hidden += value;
        }
        std::vector<const mk_log *> train;
        for (const truth::OwnedLog &log : c.train)
            train.push_back(log.get());
        const mk_log *hold = c.holdout.get();
        mk_explain_options o = {};
        o.threads = threads;
        auto e = std::make_unique<mk_explanation>();
        mk_error err = MK_ERROR_INIT;
        if (mk_explain(&c.given, train.data(), train.size(), &hold, 1, &o, e.get(), &err) !=
            MK_OK) {
            r.failed = true;
            r.said = err.message;
            return r;
        }
        judge(c, *e, r);
    } catch (const std::exception &e) {
        r.failed = true;
        r.said = e.what();
    }
    return r;
}

const char *mark(const Result &r)
{
    if (r.failed)
        return "FAILED";
    if (r.kind == "none" || r.kind == "parameters")
        return r.alarm ? "ALARM" : r.exact ? "ok" : "ok (lesser)";
    if (r.kind == "off")
        return r.unknown ? "ok" : r.alarm ? "WRONG" : "missed";
    if (r.kind == "several")
        return !r.claims                       ? "missed"
               : r.first && r.right == r.named ? "ok"
               : r.first                       ? "in part"
                                               : "WRONG";
    if (r.first)
        return r.kind == "pair" && !r.all ? "ok (one)" : "ok";
    return r.rival ? "rival" : r.weak && !r.alarm ? "missed (weak)" : r.alarm ? "WRONG" : "missed";
}

void print(uint64_t seed, const Result &r)
{
    printf("%5llu %-14s %-10s %-44s -> %-13s %-50s closed %6.3f%s %5.1f s",
           (unsigned long long)seed, r.rig.c_str(), r.kind.c_str(), r.hidden.c_str(), mark(r),
           r.said.substr(0, 110).c_str(), r.closed, r.weak ? " weak" : "", r.seconds);
    if (std::isfinite(r.error))
        printf(" off %.1f %%", 100.0 * r.error);
    printf("\n");
    fflush(stdout);
}

double quantile(std::vector<double> v, double share)
{
    if (v.empty())
        return NAN;
    std::sort(v.begin(), v.end());
    return v[(size_t)(share * (double)(v.size() - 1) + 0.5)];
}

void count_by(const std::vector<Result> &results, const char *title, bool by_rig)
{
    std::map<std::string, std::pair<int, int>> rows;
    for (const Result &r : results)
        if (r.kind == "single" && !r.weak) {
            std::string key = by_rig ? r.rig : r.hidden.substr(0, r.hidden.find(' '));
            rows[key].first += r.first;
            rows[key].second++;
        }
    printf("\n%s: right first of those that matter\n", title);
    for (const auto &row : rows)
        printf("  %-24s %3d of %3d\n", row.first.c_str(), row.second.first, row.second.second);
}

void summarise(const std::vector<Result> &results)
{
    count_by(results, "by effect", false);
    count_by(results, "by rig", true);
    int singles = 0, first = 0, rival = 0, pairs = 0, both = 0, pair_first = 0, off = 0,
        unknown = 0, clean = 0, alarms = 0, wrong = 0;
    int several = 0, several_first = 0, there = 0, found = 0, named = 0, right = 0;
    std::vector<double> closed, seconds, errors;
    for (const Result &r : results) {
        bool single = r.kind == "single", pair = r.kind == "pair";
        seconds.push_back(r.seconds);
        clean += r.kind == "none" || r.kind == "parameters";
        alarms += (r.kind == "none" || r.kind == "parameters") && r.alarm;
        several += r.kind == "several", several_first += r.kind == "several" && r.first;
        there += r.there, found += r.found, named += r.named, right += r.right;
        off += r.kind == "off" && !r.weak;
        unknown += r.kind == "off" && !r.weak && r.unknown;
        wrong += (single || pair) && r.weak && r.alarm && !r.rival;
        if (!r.weak && r.kind != "none" && r.kind != "parameters" &&
            r.hidden.find("missed") == std::string::npos)
            closed.push_back(r.closed);
        if (r.weak || (!single && !pair))
            continue;
        singles += single, first += single && r.first, rival += single && (r.first || r.rival);
        pairs += pair, both += pair && r.all, pair_first += pair && r.first;
        if (std::isfinite(r.error))
            errors.push_back(r.error);
    }
    printf("\nsingle: right first %d of %d, or a rival not to be told apart %d\n", first, singles,
           rival);
    printf("pairs: first right %d, both named %d of %d\n", pair_first, both, pairs);
    printf("off the catalogue: unknown %d of %d\n", unknown, off);
    if (several > 0)
        printf("several: first right %d of %d, %d of %d effects named, %d of %d named are there\n",
               several_first, several, found, there, right, named);
    printf("clean: %d false alarms of %d\n", alarms, clean);
    printf("too weak to matter, but misnamed: %d\n", wrong);
    printf("closed: median %.3f, worst tenth %.3f, least %.3f\n", quantile(closed, 0.5),
           quantile(closed, 0.1), quantile(closed, 0.0));
    printf("main parameter: median error %.2f %%, largest %.1f %%\n", 100.0 * quantile(errors, 0.5),
           100.0 * quantile(errors, 1.0));
    printf("seconds: median %.1f, largest %.1f\n", quantile(seconds, 0.5), quantile(seconds, 1.0));
}

void count_inside(const std::vector<double> &off, const char *what)
{
    std::vector<double> size;
    for (double one : off)
        size.push_back(std::fabs(one));
    const auto inside =
        std::count_if(size.begin(), size.end(), [](double one) { return one < 1.96; });
    printf("  %s: %d of %d inside, median error %.2f standard errors\n", what, (int)inside,
           (int)size.size(), quantile(size, 0.5));
}

// Whether what is stated is so: probabilities and intervals.
void summarise_stated(const std::vector<Result> &results)
{
    constexpr double edge[] = {0.0, 0.9, 0.98, 1.0 + 1e-9};
    printf("\nnamed causes: how often right, by the confidence stated\n");
    for (size_t i = 0; i + 1 < std::size(edge); i++) {
        int all = 0, right = 0;
        double sum = 0.0;
        for (const Result &r : results)
            for (const auto &one : r.stated)
                if (one.first >= edge[i] && one.first < edge[i + 1]) {
                    all++;
                    right += one.second;
                    sum += one.first;
                }
        if (all > 0)
            printf("  %.2f to %.2f (mean %.4f): %d of %d, %.3f\n", edge[i],
                   std::min(edge[i + 1], 1.0), sum / all, right, all, (double)right / all);
    }
    std::vector<double> base, effect;
    for (const Result &r : results) {
        base.insert(base.end(), r.base.begin(), r.base.end());
        effect.insert(effect.end(), r.effect.begin(), r.effect.end());
    }
    printf("true values inside the 95 %% intervals stated\n");
    count_inside(base, "base parameters");
    count_inside(effect, "causes' parameters");
}

bool write_case(const truth::Wish &wish, const std::string &folder)
{
    truth::Case c = truth::make_case(wish);
    char name[32];
    snprintf(name, sizeof name, "/case_%llu", (unsigned long long)wish.seed);
    std::string dir = folder + name;
    mkdir(folder.c_str(), 0777);
    mkdir(dir.c_str(), 0777);
    mk_error err = MK_ERROR_INIT;
    bool fine = mk_model_write((dir + "/base.ini").c_str(), &c.given, nullptr, &err) == MK_OK;
    for (size_t i = 0; fine && i < c.train.size(); i++)
        fine = mk_log_write((dir + "/train_" + std::to_string(i + 1) + ".csv.gz").c_str(),
                            c.train[i].get(), &err) == MK_OK;
    fine =
        fine && mk_log_write((dir + "/holdout_1.csv.gz").c_str(), c.holdout.get(), &err) == MK_OK;
    if (!fine) {
        fprintf(stderr, "%s\n", err.message);
        return false;
    }
    printf("%s: %s, %s", dir.c_str(), c.rig.kind.c_str(), c.kind.c_str());
    for (const truth::Effect &e : c.rig.effects) {
        printf(", %s", place(e.name, e.joint).c_str());
        for (const auto &value : e.value)
            printf(" %s %.6g", value.first.c_str(), value.second);
    }
    printf("\n");
    return true;
}

// Seed of a case of a run. Neighbouring seeds draw the same numbers, one place on.
uint64_t seed_of(uint64_t first, size_t number)
{
    constexpr uint64_t APART = 1009;
    return first + APART * number;
}

const char usage[] =
    "usage: mechkit-challenge [--cases N] [--seed S] [--rig R] [--kind K] [--effect E] [--joint "
    "J]\n"
    "                         [--size X] [--rate HZ] [--seconds T] [--runs N]\n"
    "                         [--stretch X] [--jobs N] [--threads N] [--write DIR]\n"
    "Hides effects in made-up logs and scores what explain says; exit 1 when a case fails.\n";

} // namespace

int main(int argc, char **argv)
{
    truth::Wish wish;
    size_t cases = 40;
    int jobs = 2, threads = 1;
    std::string folder;
    for (int i = 1; i < argc; i += 2) {
        std::string key = argv[i], value = i + 1 < argc ? argv[i + 1] : "";
        if (key == "--cases")
            cases = (size_t)atoi(value.c_str());
        else if (key == "--seed")
            wish.seed = (uint64_t)atoll(value.c_str());
        else if (key == "--rig")
            wish.rig = value;
        else if (key == "--kind")
            wish.kind = value;
        else if (key == "--effect")
            wish.effect = value;
        else if (key == "--joint")
            wish.joint = atoi(value.c_str());
        else if (key == "--size")
            wish.size = atof(value.c_str());
        else if (key == "--rate")
            wish.rate = atof(value.c_str());
        else if (key == "--seconds")
            wish.seconds = atof(value.c_str());
        else if (key == "--runs")
            wish.runs = (size_t)atoi(value.c_str());
        else if (key == "--stretch")
            wish.stretch = atof(value.c_str());
        else if (key == "--jobs")
            jobs = atoi(value.c_str());
        else if (key == "--threads")
            threads = atoi(value.c_str());
        else if (key == "--write")
            folder = value;
        else {
            fputs(usage, key == "--help" ? stdout : stderr);
            return key == "--help" ? 0 : 2;
        }
    }
    if (!(wish.stretch >= 1.0 && wish.stretch <= 10.0)) {
        fputs("mechkit-challenge: --stretch is a ratio of 1 to 10\n", stderr);
        return 2;
    }
    if (!folder.empty()) {
        try {
            for (size_t i = 0; i < cases; i++) {
                truth::Wish mine = wish;
                mine.seed = seed_of(wish.seed, i);
                if (!write_case(mine, folder))
                    return 1;
            }
        } catch (const std::invalid_argument &e) {
            fprintf(stderr, "mechkit-challenge: %s\n", e.what());
            return 2;
        }
        return 0;
    }
    std::vector<Result> results(cases);
    std::mutex talk;
    mk::parallel_for(jobs, cases, [&](size_t i) {
        truth::Wish mine = wish;
        mine.seed = seed_of(wish.seed, i);
        results[i] = play(mine, threads);
        std::lock_guard<std::mutex> lock(talk);
        print(mine.seed, results[i]);
    });
    summarise(results);
    summarise_stated(results);
    return std::any_of(results.begin(), results.end(), [](const Result &r) { return r.failed; });
}
