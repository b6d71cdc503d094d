// report.html: one page without anything outside of it, for a phone and for paper.
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "base/out_file.h"
#include "explain/report/append.hpp"
#include "explain/report/budget_text.hpp"
#include "explain/report/log_value_text.h"
#include "explain/report/places_text.h"
#include "explain/report/sharpness_text.h"
#include "ident/input_report.h"
#include "ident/owned_log.hpp"
#include "mechkit/explain.h"
#include "mechkit/sim.h"

using mk::add;
using mk::OwnedLog;

namespace
{

std::string escaped(const std::string &text)
{
    std::string s;
    for (char c : text) {
        if (c == '<')
            s += "&lt;";
        else if (c == '>')
            s += "&gt;";
        else if (c == '&')
            s += "&amp;";
        else
            s += c;
    }
    return s;
}

std::string cause_name(const mk_effect_info *effect, int joint)
{
    std::string s = effect->name;
    if (joint > 0)
        s += " at joint " + std::to_string(joint);
    return s;
}

// --- plots
// -----------------------------------------------------------------------------------------

struct Series {
    std::vector<double> x, y;
    const char *style; // class of its line, or "dots"
    const char *label;
};

// A round step that divides a span into about five.
double round_step(double span)
{
    double raw = span / 5.0, power = std::pow(10.0, std::floor(std::log10(raw)));
    for (double m : {1.0, 2.0, 5.0})
        if (m * power >= raw)
            return m * power;
    return 10.0 * power;
}

class Plot
{
  public:
    Plot(const char *x_title, const char *y_title) : x_name(x_title), y_name(y_title) {}
    void add_series(Series s) { all.push_back(std::move(s)); }
    void shade(double from, double to) { shaded.push_back({from, to}); }

    std::string svg() const
    {
        double x0 = HUGE_VAL, x1 = -HUGE_VAL, y0 = HUGE_VAL, y1 = -HUGE_VAL;
        for (const Series &s : all)
            for (size_t i = 0; i < s.x.size(); i++) {
                if (!std::isfinite(s.x[i]) || !std::isfinite(s.y[i]))
                    continue;
                x0 = std::min(x0, s.x[i]), x1 = std::max(x1, s.x[i]);
                y0 = std::min(y0, s.y[i]), y1 = std::max(y1, s.y[i]);
            }
        if (!(x1 > x0) || !std::isfinite(y0))
            return "";
        for (const auto &[from, to] : shaded)
            x0 = std::min(x0, from), x1 = std::max(x1, to);
        if (!(y1 > y0))
            y0 -= 1.0, y1 += 1.0;
        double pad = 0.06 * (y1 - y0);
        Frame f = {x0, x1, y0 - pad, y1 + pad};
        std::string s = "<svg viewBox='0 0 640 270' role='img'>";
        for (const auto &[from, to] : shaded) {
            const double left = f.px(from);
            add(s, "<rect class='left-out' x='%.1f' y='32' width='%.1f' height='190'/>", left,
                f.px(to) - left);
        }
        axes(s, f);
        for (const Series &one : all)
            draw(s, f, one);
        legend(s);
        return s + "</svg>";
    }

  private:
    struct Frame {
        double x0, x1, y0, y1;
        double px(double x) const { return 76.0 + 552.0 * (x - x0) / (x1 - x0); }
        double py(double y) const { return 222.0 - 190.0 * (y - y0) / (y1 - y0); }
    };
    const char *x_name, *y_name;
    std::vector<Series> all;
    std::vector<std::pair<double, double>> shaded; // of x

    void axes(std::string &s, const Frame &f) const
    {
        add(s, "<rect class='frame' x='76' y='32' width='552' height='190'/>");
        double step = round_step(f.x1 - f.x0);
        for (double x = std::ceil(f.x0 / step) * step; x <= f.x1 + 1e-9 * step; x += step)
            add(s, "<text class='tick' x='%.1f' y='238' text-anchor='middle'>%.4g</text>", f.px(x),
                std::fabs(x) < 1e-9 * step ? 0.0 : x);
        step = round_step(f.y1 - f.y0);
        for (double y = std::ceil(f.y0 / step) * step; y <= f.y1 + 1e-9 * step; y += step) {
            add(s, "<line class='grid' x1='76' x2='628' y1='%.1f' y2='%.1f'/>", f.py(y), f.py(y));
            add(s, "<text class='tick' x='71' y='%.1f' text-anchor='end'>%.4g</text>",
                f.py(y) + 4.0, std::fabs(y) < 1e-9 * step ? 0.0 : y);
        }
        add(s, "<text class='tick' x='352' y='260' text-anchor='middle'>%s</text>", x_name);
        add(s, "<text class='tick' x='76' y='24'>%s</text>", y_name);
    }
    static void draw(std::string &s, const Frame &f, const Series &one)
    {
        if (strcmp(one.style, "dots") == 0) {
            for (size_t i = 0; i < one.x.size(); i++)
                if (std::isfinite(one.y[i]))
                    add(s, "<circle class='dots' cx='%.1f' cy='%.1f' r='1.7'/>", f.px(one.x[i]),
                        f.py(one.y[i]));
            return;
        }
        bool open = false;
        for (size_t i = 0; i < one.x.size(); i++) {
            bool there = std::isfinite(one.y[i]);
            if (there && !open)
                add(s, "<path class='%s' d='M", one.style);
            if (there)
                add(s, "%.1f,%.1f ", f.px(one.x[i]), f.py(one.y[i]));
            else if (open)
                s += "'/>";
            open = there;
        }
        if (open)
            s += "'/>";
    }
    void legend(std::string &s) const
    {
        double x = 628.0;
        for (size_t i = all.size(); i-- > 0;) {
            if (!all[i].label)
                continue;
            x -= 8.0 * (double)strlen(all[i].label) + 34.0;
            if (strcmp(all[i].style, "dots") == 0)
                add(s, "<circle class='dots' cx='%.1f' cy='20' r='3'/>", x + 12.0);
            else
                add(s, "<polyline class='%s' points='%.1f,20 %.1f,20'/>", all[i].style, x,
                    x + 24.0);
            add(s, "<text class='tick' x='%.1f' y='24'>%s</text>", x + 29.0, all[i].label);
        }
    }
};

// --- sections
// --------------------------------------------------------------------------------------

OwnedLog predicted(const mk_model &model, const mk_log *log, double window)
{
    mk_predict_options o = {};
    o.window_s = window;
    mk_log *made = nullptr;
    if (mk_predict(&model, log, &o, &made, nullptr, nullptr, nullptr) != MK_OK)
        return nullptr;
    return OwnedLog(made);
}

// More would be a band in a plot, and take its time.
mk_log beginning_of(const mk_log &log)
{
    constexpr double SHOWN = 60.0; // s
    constexpr size_t ROWS = 100000;
    mk_log part = log; // borrows its columns
    const double *t = mk_log_get(&log, "t");
    part.rows = std::min(log.rows, ROWS);
    while (t && part.rows > 2 && t[part.rows - 1] - t[0] > SHOWN)
        part.rows--;
    return part;
}

void shade_left_out(const mk_record &r, Plot &plot)
{
    for (size_t k = 0; r.left_out && k < r.rows; k++) {
        if (r.left_out[k] == 0.0)
            continue;
        const size_t first = k;
        while (k < r.rows && r.left_out[k] != 0.0)
            k++;
        plot.shade(r.t[first] - r.t[0], r.t[k - 1] - r.t[0]);
    }
}

// A log as a bar, and what is left out of it.
void add_bar(std::string &s, const mk_left_out *first, const mk_left_out *last)
{
    constexpr double WIDTH = 640.0, HEIGHT = 14.0, LEAST = 2.0; // LEAST: what can be seen
    s += "<svg viewBox='0 0 640 14' role='img'>";
    add(s, "<rect class='whole-log' width='%g' height='%g'/>", WIDTH, HEIGHT);
    for (const mk_left_out *one = first; one < last; one++)
        add(s, "<rect class='left-out' x='%.1f' width='%.1f' height='%g'/>",
            WIDTH * one->from_s / one->log_s,
            std::max(LEAST, WIDTH * (one->to_s - one->from_s) / one->log_s), HEIGHT);
    s += "</svg>";
}

// What is left out of the logs, with the reasons.
std::string left_out_list(const mk_explanation &e)
{
    std::vector<mk_left_out> all(e.left_out, e.left_out + e.left_out_count);
    std::stable_sort(all.begin(), all.end(),
                     [](const mk_left_out &a, const mk_left_out &b) { return a.log < b.log; });
    std::string s;
    for (size_t i = 0, next = 0; i < all.size(); i = next) {
        while (next < all.size() && all[next].log == all[i].log)
            next++;
        s += "<figure class='log'><figcaption>" + escaped(all[i].file);
        add(s, ", %.4g s long:<br>", all[i].log_s);
        for (size_t k = i; k < next; k++) {
            add(s, "%.2f to %.2f s: ", all[k].from_s, all[k].to_s);
            s += escaped(all[k].why) + "<br>";
        }
        s += "</figcaption>";
        add_bar(s, all.data() + i, all.data() + next);
        s += "</figure>";
    }
    return s.empty() ? s : "<p>Left out of the logs:</p>" + s;
}

// Simulated less measured of joint j, one row in `step`, with a gap where a window begins.
void add_errors(const mk_record &record, int j, const double *q, const double *window, size_t step,
                Series &out)
{
    for (size_t k = 0; k < record.rows; k += step) {
        const double t = record.t[k] - record.t[0];
        if (k >= step && window && window[k] != window[k - step]) {
            out.x.push_back(t);
            out.y.push_back(std::nan(""));
        }
        out.x.push_back(t);
        out.y.push_back(q[k] - record.q[j][k]);
    }
}

// Error of two models over the held-out data, joint by joint: with the extension and without, or,
// where there is none, refitted and as given.
std::string error_plots(const mk_explanation &e, const mk_log *whole)
{
    const mk_log beginning = beginning_of(*whole), *log = &beginning;
    OwnedLog before = predicted(e.offered ? e.refit : e.given, log, e.window_s);
    OwnedLog after = predicted(e.offered ? e.extended : e.refit, log, e.window_s);
    mk_record record;
    std::string s;
    if (!before || !after || mk_record_from_log(log, &e.given, &record, nullptr) != MK_OK)
        return s;
    size_t step = record.rows / 1500 + 1;
    for (int j = 0; j < mk_model_joints(&e.given); j++) {
        const char *name = mk_log_angle(j);
        const double *b = mk_log_get(before.get(), name), *a = mk_log_get(after.get(), name);
        Series sb = {{}, {}, "before", e.offered ? "refitted" : "given"};
        Series sa = {{}, {}, "after", e.offered ? "extended" : "refitted"};
        const double *w = mk_log_get(before.get(), "window");
        add_errors(record, j, b, w, step, sb);
        add_errors(record, j, a, w, step, sa);
        const std::string error = "q" + std::to_string(j + 1) + " simulated - measured, " +
                                  mk_model_unit(&e.given, j, "rad");
        Plot plot("time, s", error.c_str());
        plot.add_series(std::move(sb));
        plot.add_series(std::move(sa));
        shade_left_out(record, plot);
        s += "<figure>" + plot.svg() + "</figure>";
    }
    return s;
}

// Torque of the causes in the equation of joint j when its speed (or angle) has a value and nothing
// else moves; empty where that does not say it all.
Series law(const mk_explanation &e, int j, bool speed, double low, double high)
{
    Series s = {{}, {}, "after", "fitted law"};
    for (int c = 0; c < e.cause_count; c++)
        if (e.cause[c].effect->state_count > 0 || !(e.cause[c].effect->stages & MK_STAGE_TORQUE))
            return s;
    mk_model bare = e.extended;
    bare.effect_count = e.given.effect_count;
    int n = mk_model_joints(&bare);
    bool flat = true;
    for (int i = 0; i <= 200; i++) {
        double x[MK_MAX_STATES] = {0.0}, with[MK_MAX_STATES], without[MK_MAX_STATES];
        double u[MK_MAX_INPUTS] = {0.0, 0.0}, mass[4], h[2];
        for (int k = 0; k < n; k++)
            x[k] = mk_plant(bare.plant)->rest[k];
        double at = low + (high - low) * i / 200.0;
        x[speed ? n + j : j] = at;
        mk_model_rhs(&e.extended, 0.0, x, u, with);
        mk_model_rhs(&bare, 0.0, x, u, without);
        mk_plant_mass(&bare, x, x + n, mass, h);
        double torque = 0.0;
        for (int k = 0; k < n; k++)
            torque += mass[j * n + k] * (with[n + k] - without[n + k]);
        flat = flat && std::fabs(torque - (s.y.empty() ? torque : s.y[0])) < 1e-9;
        s.x.push_back(at);
        s.y.push_back(torque);
    }
    if (flat)
        s.x.clear(), s.y.clear();
    return s;
}

// Residual torque against what it seems to hang on, the law of a cause drawn through where it is
// one of speed or angle alone.
std::string residual_torque_plots(const mk_explanation &e)
{
    std::string s;
    int n = mk_model_joints(&e.given);
    int j = n > 1 && e.missing[1] > e.missing[0] ? 1 : 0;
    for (int c = 0; c < e.cause_count; c++)
        if (e.cause[c].joint > 0 && c == 0)
            j = e.cause[c].joint - 1;
    const std::string against[] = {std::string("speed of the joint, ") +
                                       mk_model_unit(&e.given, j, "rad/s"),
                                   std::string(e.given.joint_linear[j] ? "position" : "angle") +
                                       " of the joint, " + mk_model_unit(&e.given, j, "rad"),
                                   "command u"};
    for (int kind = 0; kind < 3; kind++) {
        Series dots = {{}, {}, "dots", "residual torque"};
        for (int i = 0; i < e.residual_torque_count; i++) {
            const mk_residual_torque &p = e.residual_torque[i];
            dots.x.push_back(kind == 0 ? p.v[j] : kind == 1 ? p.q[j] : p.u);
            dots.y.push_back(p.torque[j]);
        }
        Plot plot(against[kind].c_str(), j == 0 ? "torque in the equation of joint 1"
                                                : "torque in the equation of joint 2");
        if (kind < 2 && !dots.x.empty()) {
            auto ends = std::minmax_element(dots.x.begin(), dots.x.end());
            Series line = law(e, j, kind == 0, *ends.first, *ends.second);
            if (!line.x.empty())
                plot.add_series(std::move(line));
        }
        plot.add_series(std::move(dots));
        s += "<figure>" + plot.svg() + "</figure>";
    }
    return s;
}

// A cause, and what these data cannot tell from it.
std::string either(const mk_explanation &e, int cause)
{
    constexpr int SHOWN = 2;
    std::string s = cause_name(e.cause[cause].effect, e.cause[cause].joint);
    for (int i = 0, shown = 0; i < e.rival_count && shown < SHOWN; i++) {
        const mk_rival &r = e.rival[i];
        if (r.instead_of == cause && !r.distinguishable) {
            s += " or " + cause_name(r.effect, r.joint);
            shown++;
        }
    }
    return s;
}

std::string sentence(const mk_explanation &e)
{
    std::string s;
    switch (e.verdict) {
    case MK_VERDICT_NONE:
        return "The model explains the data: nothing is missing, and its values are right.";
    case MK_VERDICT_PARAMETERS:
        return "Only the values of parameters were wrong; nothing is missing in the model.";
    case MK_VERDICT_EFFECT:
        for (int i = 0; i < e.cause_count; i++)
            s += (i ? ", and " : "") + either(e, i);
        for (int i = 0; i < e.log_value_count; i++)
            s += (s.empty() ? "" : ", and ") +
                 cause_name(e.log_value[i].effect, e.log_value[i].joint) +
                 " of its own in every log";
        if (e.input.changed)
            s += (s.empty() ? "" : ", and ") + std::string(e.input.taken == MK_INPUT_COMMANDED
                                                               ? "the command as it was sent"
                                                               : "the command as it was measured");
        return "The model lacks " + s + ".";
    case MK_VERDICT_PARTIAL:
        for (int i = 0; i < e.cause_count - e.piece_count; i++)
            s += (i ? ", and " : "") + either(e, i);
        return "The model lacks " + s + "; " +
               (mk_explanation_leaves_little(&e) ? "a small rest has no name."
                                                 : "that is a part of what is missing.");
    default:
        if (e.partly_named && e.offered)
            return "Known effects explain a part of what is missing; the rest has no name.";
        return "Something is missing that no known effect explains.";
    }
}

// Of what has no name.
std::string formula(const mk_explanation &e)
{
    if (!e.structure[0])
        return "";
    const char *what = e.verdict == MK_VERDICT_PARTIAL ? "And a torque that has no name: "
                       : e.cause_count == 0            ? ""
                       : !e.offered     ? "Fits what was learned from, but not the held-out data: "
                       : e.partly_named ? "The part: "
                                        : "As a formula: ";
    return "<p>" + escaped(what + std::string(e.structure)) + "</p>";
}

// What the field calls a cause, where it usually comes from, what to do: a row of the table.
std::string words_row(const mk_effect_info *effect)
{
    const mk_effect_words *words = mk_effect_in_words(effect);
    if (!words->title)
        return "";
    return "<tr><td></td><td colspan='3'>That is " + escaped(words->title) +
           ". Usual cause: " + escaped(words->usual) + " What to do: " + escaped(words->remedy) +
           "</td></tr>";
}

std::string suspects_text(const mk_explanation &e)
{
    if (e.suspect_count == 0)
        return "";
    std::string s = "<p>Suspects, which seem to help on parts of the data that were left out, but "
                    "not surely:</p><ul>";
    for (int i = 0; i < e.suspect_count; i++) {
        const mk_suspect &one = e.suspect[i];
        s += "<li>" + cause_name(one.effect, one.joint);
        add(s, ": closes %.0f %% of the gap, better in %d of %d parts</li>", 100.0 * one.share,
            one.better_in, one.parts);
    }
    return s + "</ul>";
}

// What is claimed of a cause.
std::string standing(const mk_explanation &e, const mk_cause &c)
{
    constexpr double MORE_LIKELY_THAN_NOT = 0.5;
    if (!e.offered)
        return "not offered: it does not carry over to held-out data";
    std::string s = c.confidence > MORE_LIKELY_THAN_NOT
                        ? "named"
                        : "one of several that these data do not tell apart";
    add(s, ", confidence %.3f", c.confidence);
    return s;
}

std::string log_value_row(const mk_explanation &e, const mk_cause &c)
{
    std::string s = "<tr><td><b>" + cause_name(c.effect, c.joint) + "</b>, log by log</td><td>";
    for (int k = 0; k < c.effect->parameter_count; k++) {
        const char *unit = mk_effect_parameter_unit(&e.given, c.joint, &c.effect->parameter[k]);
        if (!(c.spread[k] > 0.0))
            continue;
        add(s, "%s: %.2g %s from log to log", c.effect->parameter[k].name, c.spread[k], unit);
        for (int i = 0; i < e.per_log_count; i++)
            if (e.per_log[i].effect == c.effect && e.per_log[i].joint == c.joint)
                add(s, "<br>log %d: %.3g &plusmn; %.1g %s", e.per_log[i].log + 1,
                    e.per_log[i].value, e.per_log[i].std_error, unit);
    }
    const char *apart = mk_apart_sentence(&e, &c);
    if (*apart)
        add(s, "<br>%s", apart);
    add(s, "</td><td>%.0f better than one for all</td><td>", c.delta_bic);
    return s + standing(e, c) + "</td></tr>";
}

std::string input_text(const mk_explanation &e)
{
    char what[400];
    mk_input_sentence(&e.input, what, sizeof what);
    what[0] = (char)std::toupper((unsigned char)what[0]);
    return "<p>" + escaped(what) + ".</p>";
}

std::string places_text(const mk_explanation &e)
{
    char what[4096];
    mk_places_sentence(&e, what, sizeof what);
    what[0] = (char)std::toupper((unsigned char)what[0]);
    return "<p>" + escaped(what) + ".</p>";
}

std::string cause_table(const mk_explanation &e)
{
    std::string s =
        "<div><table><tr><th>Cause</th><th>Parameters</th><th>BIC</th><th>Verdict</th></tr>";
    for (int i = 0; i < e.cause_count; i++) {
        const mk_cause &c = e.cause[i];
        if (i >= e.cause_count - e.piece_count && e.verdict == MK_VERDICT_PARTIAL)
            break; // the formula stands above
        s += "<tr><td><b>" + cause_name(c.effect, c.joint) + "</b></td><td>";
        for (int k = 0; k < c.effect->parameter_count; k++) {
            if (mk_parameter_goes_without_saying(&c.effect->parameter[k], e.given.plant))
                continue;
            add(s, "%s%s = %.4g", k ? "<br>" : "", c.effect->parameter[k].name, c.value[k]);
            if (std::isfinite(c.std_error[k]))
                add(s, " &plusmn; %.2g", c.std_error[k]);
            add(s, " %s", mk_effect_parameter_unit(&e.given, c.joint, &c.effect->parameter[k]));
        }
        add(s, "</td><td>%.0f better with it</td><td>", c.delta_bic);
        s += standing(e, c) + "</td></tr>" + words_row(c.effect);
    }
    for (int i = 0; i < e.log_value_count; i++)
        s += log_value_row(e, e.log_value[i]) + words_row(e.log_value[i].effect);
    for (int i = 0; i < e.rival_count; i++) {
        const mk_rival &r = e.rival[i];
        s += "<tr><td>" + cause_name(r.effect, r.joint) + "</td><td></td>";
        r.distinguishable
            ? add(s, "<td>%.0f worse</td><td>ruled out</td></tr>", r.delta_bic)
            : add(s, "<td>%.1f apart</td><td>cannot be told apart on these data</td></tr>",
                  std::fabs(r.delta_bic));
    }
    return s + "</table></div>";
}

// Base parameters, and those of effects that the given model has already.
std::string parameter_table(const mk_explanation &e)
{
    std::string s = "<div><table><tr><th>Parameter</th><th>given</th><th>refitted</th>";
    s += e.offered ? "<th>with the cause</th>" : "";
    s += "<th>95 % interval</th></tr>";
    const mk_plant_info *plant = mk_plant(e.given.plant);
    const mk_model &fitted = e.offered ? e.extended : e.refit;
    auto row = [&](const std::string &name, double given, double refit, double value, double half) {
        s += "<tr><td>" + name + "</td>";
        std::isfinite(given) ? add(s, "<td>%.5g</td>", given) : add(s, "<td>?</td>");
        add(s, "<td>%.5g</td>", refit);
        if (e.offered)
            add(s, "<td>%.5g</td>", value);
        std::isfinite(half) ? add(s, "<td>%.5g .. %.5g</td></tr>", value - half, value + half)
                            : add(s, "<td></td></tr>");
    };
    for (int i = 0; i < plant->parameter_count; i++)
        row(plant->parameter[i].name + std::string(", ") + plant->parameter[i].help,
            e.unknown[i] ? std::nan("") : e.given.parameter[i], e.refit.parameter[i],
            fitted.parameter[i], 1.96 * e.std_error[i]);
    for (int i = 0; i < e.given.effect_count; i++) {
        const mk_effect_use &given = e.given.effect[i];
        const mk_effect_info *info = mk_effect(given.index);
        for (int k = 0; k < info->parameter_count; k++)
            if (!mk_parameter_goes_without_saying(&info->parameter[k], plant->kind))
                row(cause_name(info, given.joint) + ", " + info->parameter[k].name, given.value[k],
                    e.refit.effect[i].value[k], fitted.effect[i].value[k], std::nan(""));
    }
    s += "</table></div>";
    for (int i = 0; i < plant->parameter_count; i++)
        if (mk_explanation_doubts_mass(&e, i))
            add(s,
                "<p>%s is far from what was given: nobody weighs so badly, and something that the "
                "model lacks may be in its place.</p>",
                plant->parameter[i].name);
    return s;
}

// Which readings the models mispredict from one sample to the next, and with what that goes.
std::string residual_table(const mk_explanation &e)
{
    const double level = 0.01 / std::max(e.residual_test_count, 1);
    std::string s = "<div><table><tr><th>Error of</th><th>goes with</th><th>refitted</th>"
                    "<th>extended</th></tr>";
    auto cell = [&](double figure, double p) {
        add(s, p < level ? "<td><b>%.3f</b></td>" : "<td>%.3f</td>", figure);
    };
    for (int i = 0; i < e.residual_test_count; i++) {
        const mk_residual_test &t = e.residual_test[i];
        bool itself = strcmp(t.with, "itself") == 0;
        if (itself)
            add(s, "<tr><td>q%d</td><td>size, 1 if right</td><td>%.4g</td><td>%.4g</td></tr>",
                t.joint, e.one_step_refit[t.joint - 1], e.one_step_extended[t.joint - 1]);
        add(s, "<tr><td>q%d</td><td>%s</td>", t.joint,
            itself ? "itself, up to 20 samples before" : t.with);
        cell(t.before, t.p_before);
        cell(t.after, t.p_after);
        s += "</tr>";
    }
    add(s,
        "</table></div><p>Correlations; bold: not by chance (%.1g in a test, 1 %% in all, "
        "Ljung-Box "
        "and Fisher's z). With a right model nothing is bold.</p>",
        level);
    return s;
}

// What a controller makes of what it believes, on a virtual rig that is the extended model.
std::string control_table(const mk_explanation &e)
{
    const mk_plant_info *plant = mk_plant(e.given.plant);
    const int held = plant->joint_is_wheel[plant->motor_joint] ? 0 : plant->motor_joint;
    std::string s = "<div><table><tr><th>Setup</th><th>believes</th><th>held</th><th>caught, s</th>"
                    "<th>error, rms</th>";
    add(s, "<th>joint %d off, %s</th><th>command, rms</th></tr>", held + 1,
        mk_model_unit(&e.given, held, "rad"));
    auto cell = [&](double value) {
        std::isfinite(value) ? add(s, "<td>%.3g</td>", value) : add(s, "<td></td>");
    };
    for (int i = 0; i < e.control_count; i++) {
        const mk_control_gain &c = e.control[i];
        const mk_control_figures *figures[] = {&c.given, &c.refit, &c.extended};
        const char *beliefs[] = {"given", "refitted", "extended"};
        for (int k = 0; k < 3; k++) {
            const mk_control_figures &f = *figures[k];
            add(s, "<tr><td>%s</td><td>%s</td><td>%.0f of %d</td>", k ? "" : c.setup, beliefs[k],
                f.held * c.runs, c.runs);
            for (double value : {f.caught_s, f.error, f.off, f.effort})
                cell(value);
            s += "</tr>";
        }
    }
    s += "</table></div>";
    for (int i = 0; i < e.control_count; i++) {
        const char *believing, *worse = mk_control_gain_worse(&e.control[i], &believing);
        if (worse)
            add(s,
                "<p><b>%s: believing the extended model it %s than believing the %s one. Leave the "
                "controller that one.</b></p>",
                e.control[i].setup, worse, believing);
    }
    return s +
           "<p>Medians. Error: sway of the upright link in rad; under speed control "
           "of the speed in " +
           mk_model_unit(&e.given, -1, "rad/s") + ".</p>";
}

std::string advice(const mk_explanation &e)
{
    if (e.next.why[0] && e.next.rival >= 0)
        return std::string("To be tested next: ") + e.next.why + ".";
    bool tied = false;
    for (int i = 0; i < e.rival_count; i++)
        tied = tied || !e.rival[i].distinguishable;
    if (tied)
        return "Some causes cannot be told apart on these data: record another excitation (free "
               "swings "
               "from several angles, slow ramps both ways, steps) and explain all logs together.";
    if (e.cause_count > 0 && !e.offered)
        return "What was found on the training data predicts the held-out data no better than the "
               "refitted "
               "model: it is not offered, and extended.ini is the refitted model. Record more "
               "data.";
    if (e.verdict == MK_VERDICT_UNKNOWN && !e.offered)
        return "Nothing of the catalogue and no term of the library explains what is left: "
               "extended.ini is the refitted model, the best that there is. What the rest goes "
               "with "
               "and the suspects say where to look; free swings, slow ramps both ways and steps "
               "tell more of drag, friction and play, slack and delay.";
    if (e.verdict == MK_VERDICT_UNKNOWN)
        return "Look for a mechanism that makes this torque. The formula is in extended.ini and "
               "can be "
               "simulated, but it holds only for motions like those in the data.";
    if (e.verdict == MK_VERDICT_NONE)
        return "Go on with the model as it is; extended.ini is the same.";
    if (mk_explanation_misleads_control(&e))
        return "Use extended.ini for simulation and the virtual board. Leave controllers the model "
               "that they do better with: see the trial in control.";
    return "Use extended.ini from now on: simulation, virtual board and controllers read it.";
}

std::string limits(const mk_explanation &e)
{
    std::string s = "<p>Causes that were looked for and not found would have been named from these "
                    "sizes on; smaller ones may hide in these data.</p><ul>";
    for (int i = 0; i < e.detection_limit_count; i++) {
        const mk_detection_limit &l = e.detection_limit[i];
        const mk_parameter_info &p = l.effect->parameter[l.parameter];
        s += "<li>" + cause_name(l.effect, l.joint);
        add(s, ": %s above %.2g %s</li>", p.name, l.least,
            mk_effect_parameter_unit(&e.given, l.joint, &p));
    }
    return s + "</ul>";
}

// What is doubted of the data comes before anything that was learned from them.
std::string data_checks(const mk_explanation &e)
{
    std::string s;
    for (int i = 0; i < e.data_check.count; i++) {
        const mk_data_finding &f = e.data_check.finding[i];
        s += i ? "<li>" : "<h2>Data check</h2><ul><li>";
        add(s, "<b>%s</b>: ", mk_data_severity_name(f.severity));
        s += escaped(f.file);
        if (f.line > 0)
            add(s, ":%d", f.line);
        s += ": " + escaped(f.what) + "<br>To do: " + escaped(f.remedy) + "</li>";
    }
    return s.empty() ? s : s + "</ul>";
}

const char style[] =
    "body{font:16px/1.45 system-ui,sans-serif;max-width:44em;margin:1.5em auto;padding:0 1em;"
    "color:#222}h1{font-size:1.35em}h2{font-size:1.1em;margin-top:1.6em}"
    "table{border-collapse:collapse;width:100%;font-size:.88em}td,th{border-bottom:1px solid #ccc;"
    "padding:.3em .5em;text-align:left;vertical-align:top}figure{margin:1em 0}svg{width:100%}"
    "div{overflow-x:auto}"
    ".left-out{fill:#f3d9b0;stroke:none}.whole-log{fill:#dfe6ee}.log{margin:.4em 0}"
    ".log figcaption{font-size:.85em}.frame{fill:none;stroke:#888}.grid{stroke:#e4e4e4}.tick{"
    "font-size:12px;fill:#444}"
    ".bar-model{fill:#888}.bar-cause{fill:#06c}.bar-off{fill:#9bd}.bar-noise{fill:#ccc}"
    "figcaption{font-size:.85em;color:#444}"
    ".before{fill:none;stroke:#c60;stroke-width:1.2;stroke-dasharray:5 3}"
    ".after{fill:none;stroke:#06c;stroke-width:1.4}.dots{fill:#333;fill-opacity:.55}"
    "@media(max-width:30em){table{font-size:.75em}td,th{padding:.25em .3em}.tick{font-size:16px}}"
    "@media print{body{max-width:none}}";

// What it takes to file a report, and to make it again.
std::string origin_text(const mk_explanation &e)
{
    if (!e.origin)
        return "";
    std::string s = "<h2>Where this comes from</h2><div><table><tr><th>date</th><td>" +
                    escaped(e.origin->date) +
                    "</td></tr><tr><th>program</th><td>mechkit " MK_VERSION
                    "</td></tr><tr><th>command</th><td><code>" +
                    escaped(e.origin->command) + "</code></td></tr><tr><th>model</th><td>" +
                    escaped(e.origin->model) + "</td></tr><tr><th>learned from</th><td>";
    for (size_t i = 0; i < e.origin->log_count; i++)
        s += (i ? "<br>" : "") + escaped(e.origin->logs[i]);
    return s + "</td></tr></table></div>";
}

} // namespace

enum mk_status mk_explanation_write_html(const mk_explanation *e, const char *path,
                                         const mk_log *log, mk_error *err)
try {
    std::string s = "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
                    "<meta name='viewport' content='width=device-width,initial-scale=1'>"
                    "<title>mechkit explain</title><style>";
    s += style;
    s += "</style></head><body>" + data_checks(*e) + "<h1>" + escaped(sentence(*e)) + "</h1>" +
         formula(*e);
    s += left_out_list(*e);
    add(s, "<p>Rig: %s. Free runs of %g s on held-out data", mk_plant(e->given.plant)->name,
        e->window_s);
    if (e->held_back)
        add(s, " (the last log from %.3g to %.3g s)", e->held_from, e->held_to);
    s += ":</p>";
    s += mk::budget_html(*e);
    if (mk_explanation_doubts_logs(e))
        s += "<p>The given model predicts the held-out data better than the refitted one: are all "
             "logs of the same rig, with the same signs, units and columns?</p>";
    char sharpness[160];
    mk_sharpness_sentence(e, sharpness, sizeof sharpness);
    if (sharpness[0])
        add(s, "<p>%s</p>", sharpness);
    if (e->held_counts_corrected > 0)
        add(s,
            "<p>Steps of the readings were put back in the held-out data as well, %d of them: "
            "these "
            "errors are without.</p>",
            e->held_counts_corrected);
    if (mk_explanation_goes_beyond(e))
        add(s,
            "<p>Held-out data are predicted far worse than they are read, and their commands are "
            "up "
            "to %.2g times the largest one to learn from: a limit or a stop that only they meet is "
            "in no model. Learn from such data too.</p>",
            e->command_beyond);
    else if (mk_explanation_misses_held_out(e))
        s += "<p>Held-out data are predicted far worse than they are read: they may show what the "
             "other logs do not. Learn from such data too.</p>";
    s += "<h2>Before and after</h2>" + error_plots(*e, log);
    if (e->verdict >= MK_VERDICT_EFFECT)
        s += "<h2>Residual torque: what acts beyond the model without the cause</h2>" +
             residual_torque_plots(*e);
    if (e->input.made)
        s += "<h2>Which column drives it</h2>" + input_text(*e);
    if (e->places.joint > 0)
        s += "<h2>Where counters were zeroed</h2>" + places_text(*e);
    if (e->cause_count + e->log_value_count + e->rival_count > 0)
        s += "<h2>Hypotheses</h2>" + cause_table(*e);
    s += suspects_text(*e);
    if (e->detection_limit_count > 0)
        s += "<h2>What would have been seen</h2>" + limits(*e);
    if (e->residual_test_count > 0)
        s += "<h2>Prediction from one sample to the next</h2>" + residual_table(*e);
    if (e->control_count > 0)
        s += "<h2>In control, on a virtual rig that is the extended model</h2>" + control_table(*e);
    s += "<h2>Parameters</h2>" + parameter_table(*e);
    s += "<h2>What to do next</h2><p>" + advice(*e) + "</p>";
    add(s, "<p>%d candidate causes, %.1f s.</p>", e->tried, e->seconds);
    s += origin_text(*e) + "</body></html>\n";
    return mk_out_file_save(path, s.data(), s.size(), err);
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for the report");
}
