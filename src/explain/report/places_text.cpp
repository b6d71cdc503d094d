#include "explain/report/places_text.h"

#include <cstdio>
#include <string>

#include "explain/report/append.hpp"

using namespace mk;

void mk_places_sentence(const mk_explanation *e, char *text, size_t size)
{
    const mk_places &p = e->places;
    std::string s;
    if (p.joint > 0) {
        add(s,
            "the counter of joint %d was zeroed elsewhere in each log, as what repeats with its "
            "angle says (%s, %g times a turn). Counted from the zero of log 1, but for multiples "
            "of 1/%g of a turn:",
            p.joint, p.by->name, p.cycles, p.cycles);
        for (int i = 1; i < p.count; i++) {
            const bool learned = i < p.learned;
            add(s, "%s %s %d %.4g +- %.1g %s", i > 1 ? "," : "", learned ? "log" : "hold-out",
                learned ? i + 1 : i - p.learned + 1, p.shift[i], p.std_error[i],
                mk_model_unit(&e->given, p.joint - 1, "rad"));
        }
    }
    std::snprintf(text, size, "%s", s.c_str());
}
