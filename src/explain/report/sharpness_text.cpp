#include "explain/report/sharpness_text.h"

#include <cstdio>

// The refitted model is told of where the given values are kept, or an extension is not offered.
void mk_sharpness_sentence(const mk_explanation *e, char *text, size_t size)
{
    const double given = e->given.friction_sharpness, extended = e->extended.friction_sharpness;
    const double k = extended != given ? extended : e->refit.friction_sharpness;
    const bool slides = e->given.joint_linear[mk_plant(e->given.plant)->motor_joint];
    text[0] = '\0';
    if (k != given)
        std::snprintf(text, size,
                      "Dry friction changes its sign %s sharply than the given model has it: "
                      "friction_sharpness = %.3g, given %.3g %s.",
                      k > given ? "more" : "less", k, given, slides ? "s/m" : "s/rad");
}
