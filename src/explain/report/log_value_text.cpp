#include "explain/report/log_value_text.h"

const char *mk_apart_sentence(const mk_explanation *e, const mk_cause *c)
{
    for (int i = 0; i < e->per_log_count; i++) {
        const mk_per_log &v = e->per_log[i];
        if (v.effect == c->effect && v.joint == c->joint && v.mean_open)
            return "How far the logs are apart is known; what they have in common is among the "
                   "other parameters.";
    }
    return "";
}
