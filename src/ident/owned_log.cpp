#include "ident/owned_log.hpp"

#include <algorithm>
#include <cstdio>
#include <new>

namespace mk
{

OwnedLog rows_of_log(const mk_log &log, size_t first, size_t last)
{
    mk_log *made = nullptr;
    if (mk_log_create(last - first, &made) != MK_OK)
        throw std::bad_alloc();
    OwnedLog out(made);
    for (size_t c = 0; c < log.column_count; c++) {
        if (!log.columns[c].data)
            continue;
        double *data = mk_log_add_column(made, log.columns[c].name);
        if (!data)
            throw std::bad_alloc();
        std::copy(log.columns[c].data + first, log.columns[c].data + last, data);
    }
    for (size_t m = 0; m < log.meta_count; m++)
        if (log.meta[m].key[0] &&
            mk_log_set_meta(made, log.meta[m].key, log.meta[m].value) == MK_ERR_NOMEM)
            throw std::bad_alloc();
    char begins[32];
    const double *t = mk_log_get(&log, "t");
    std::snprintf(begins, sizeof begins, "%.17g", t ? t[0] : 0.0);
    if (!mk_log_find_meta(&log, "begins_s") &&
        mk_log_set_meta(made, "begins_s", begins) == MK_ERR_NOMEM)
        throw std::bad_alloc();
    return out;
}

} // namespace mk
