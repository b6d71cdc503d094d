#include "explain/report/budget_text.hpp"

#include "explain/report/append.hpp"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <vector>

namespace mk
{

namespace
{

// One bar of the waterfall: the errors of a model, and what it has beyond the one before.
struct Bar {
    std::string label;
    double rms[MK_MAX_JOINTS];
    const mk_budget_item *item; // NULL: given, refitted, extended model, or noise
    const char *style;
};

std::vector<Bar> bars_of(const mk_explanation &e)
{
    const mk_budget &b = e.budget;
    std::vector<Bar> bars;
    auto push = [&](const char *label, const double *rms, const mk_budget_item *item,
                    const char *style) {
        Bar bar = {label, {}, item, style};
        std::copy_n(rms, MK_MAX_JOINTS, bar.rms);
        bars.push_back(bar);
    };
    push("given model", b.given, nullptr, "bar-model");
    push("refitted", b.refit, nullptr, "bar-model");
    for (int i = 0; i < b.item_count; i++) {
        char name[160];
        mk_budget_item_name(&e, &b.item[i], name, sizeof name);
        push(name, b.item[i].rms, &b.item[i], "bar-cause");
    }
    if (b.item_count > 0)
        push("extended", b.extended, nullptr, "bar-model");
    push("noise of the readings", b.noise, nullptr, "bar-noise");
    return bars;
}

// Errors by joint on a logarithmic axis: they span decades.
std::string waterfall(const mk_explanation &e, int joint, const std::vector<Bar> &bars)
{
    constexpr double LEFT = 250.0, RIGHT = 560.0, ROW = 22.0, HEIGHT = 15.0, TOP = 8.0;
    double low = HUGE_VAL, high = 0.0;
    for (const Bar &bar : bars)
        if (bar.rms[joint] > 0.0 && std::isfinite(bar.rms[joint]))
            low = std::min(low, bar.rms[joint]), high = std::max(high, bar.rms[joint]);
    if (!(high > 0.0))
        return "";
    low *= 0.7;
    auto at = [&](double x) {
        return LEFT + (RIGHT - LEFT) * std::log(std::max(x, low) / low) / std::log(high / low);
    };
    std::string s;
    add(s, "<svg viewBox='0 0 640 %.0f' role='img'>", TOP + ROW * (double)bars.size() + 4.0);
    for (size_t i = 0; i < bars.size(); i++) {
        const Bar &bar = bars[i];
        const double y = TOP + ROW * (double)i, x = bar.rms[joint];
        const std::string label =
            bar.label.size() > 40 ? bar.label.substr(0, 38) + "..." : bar.label;
        add(s, "<text class='tick' x='%.0f' y='%.1f' text-anchor='end'>%s%s</text>", LEFT - 8.0,
            y + 12.0, bar.item ? "+ " : "", label.c_str());
        // What an item takes off is drawn pale up to where the one before it ended.
        if (bar.item && i > 0)
            add(s, "<rect class='bar-off' x='%.1f' y='%.1f' width='%.1f' height='%.0f'/>",
                std::min(at(x), at(bars[i - 1].rms[joint])), y,
                std::fabs(at(bars[i - 1].rms[joint]) - at(x)), HEIGHT);
        add(s, "<rect class='%s' x='%.1f' y='%.1f' width='%.1f' height='%.0f'/>", bar.style, LEFT,
            y, std::max(at(x) - LEFT, 1.0), HEIGHT);
        add(s, "<text class='tick' x='%.1f' y='%.1f'>%.3g</text>",
            std::max(at(x), bar.item && i > 0 ? at(bars[i - 1].rms[joint]) : 0.0) + 5.0, y + 12.0,
            1e3 * x);
    }
    add(s, "</svg><figcaption>Joint %d: rms error of free runs, m%s (logarithmic)</figcaption>",
        joint + 1, mk_model_unit(&e.given, joint, "rad"));
    return "<figure>" + s + "</figure>";
}

std::string table(const mk_explanation &e, const std::vector<Bar> &bars)
{
    const mk_budget &b = e.budget;
    std::string s = "<div><table><tr><th></th>";
    for (int j = 0; j < mk_model_joints(&e.given); j++)
        add(s, "<th>q%d, m%s</th><th>times noise</th>", j + 1, mk_model_unit(&e.given, j, "rad"));
    s += "<th>share of the gap</th><th>90 %</th><th>chosen again</th></tr>";
    for (const Bar &bar : bars) {
        add(s, "<tr><td>%s%s</td>", bar.item ? "+ " : "", bar.label.c_str());
        for (int j = 0; j < mk_model_joints(&e.given); j++)
            add(s, "<td>%.3g</td><td>%.3g</td>", 1e3 * bar.rms[j],
                bar.rms[j] / std::max(b.noise[j], 1e-300));
        if (bar.item) {
            add(s, "<td>%.0f %%</td><td>%.0f .. %.0f</td>", 100.0 * bar.item->share,
                100.0 * bar.item->low, 100.0 * bar.item->high);
            std::isfinite(bar.item->inclusion)
                ? add(s, "<td>%.0f %%</td>", 100.0 * bar.item->inclusion)
                : add(s, "<td></td>");
        } else {
            add(s, "<td>%s</td><td></td><td></td>",
                b.item_count == 0         ? ""
                : bar.label == "refitted" ? "100 %"
                                          : "");
        }
        s += "</tr>";
    }
    return s + "</table></div>";
}

} // namespace

std::string budget_html(const mk_explanation &e)
{
    const mk_budget &b = e.budget;
    const std::vector<Bar> bars = bars_of(e);
    std::string s;
    for (int j = 0; j < mk_model_joints(&e.given); j++)
        s += waterfall(e, j, bars);
    s += table(e, bars);
    if (b.item_count > 0)
        add(s,
            "<p>The extension closes <b>%.0f %%</b> of the gap between the refitted model and "
            "the noise.",
            100.0 * b.closed);
    if (b.rest_joint > 0 && b.item_count > 0) {
        add(s, " <b>%.0f %%</b> is not explained, most of it at joint %d", 100.0 * b.rest,
            b.rest_joint);
        for (int i = 0; i < b.goes_with_count; i++)
            add(s, "%s%s", i ? ", " : "; it goes with ", b.goes_with[i]);
        s += ".";
    }
    return s + (b.item_count > 0 ? "</p>" : "");
}

} // namespace mk
