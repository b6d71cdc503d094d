/* An excitation as a command file. */
#include <stdio.h>
#include <string.h>

#include "base/out_file.h"
#include "mechkit/excite.h"
#include "mechkit/number.h"

/* "dir/NAME.cmd" to "dir/NAME". */
static enum mk_status stem_of(const char *path, char *out, size_t size, struct mk_error *err)
{
    size_t n = strlen(path);
    if (n >= 4 && strcmp(path + n - 4, ".cmd") == 0)
        n -= 4;
    if (n + 5 > size)
        return mk_error_set(err, MK_ERR_RANGE, "the path is too long: %s", path);
    memcpy(out, path, n);
    out[n] = '\0';
    return MK_OK;
}

enum mk_status mk_excitation_write(const struct mk_excitation *e, const char *path,
                                   const char *model, struct mk_error *err)
{
    char stem[480], text[2600], csv[500], input[1100], seconds[MK_NUMBER_MAX];
    enum mk_status st = stem_of(path, stem, sizeof stem, err);
    if (st != MK_OK)
        return st;
    const char *slash = strrchr(stem, '/'), *name = slash ? slash + 1 : stem;
    snprintf(csv, sizeof csv, "%s.csv", stem);
    if (e->input[0])
        snprintf(input, sizeof input, "%s", e->input);
    else
        snprintf(input, sizeof input, "@%s.csv", name);
    mk_format_double(seconds, e->seconds);
    int n = snprintf(text, sizeof text,
                     "# Excitation by criterion %s; foreseen largest standard error %.2g %%.\n"
                     "model %s\nsetup open-loop\nrate %.0f\ninput %s\nstart\nwait %s\n"
                     "expect no-fault\nhalt\nsave %s-log.csv\nquit\n",
                     mk_excite_criterion_name(e->criterion), 100.0 * e->figures.worst, model,
                     e->rate_hz, input, seconds, name);
    if (n < 0 || (size_t)n >= sizeof text)
        return mk_error_set(err, MK_ERR_RANGE, "the path of the model is too long: %s", model);
    if (!e->input[0] && (st = mk_log_write(csv, e->plan, err)) != MK_OK)
        return st;
    return mk_out_file_save(path, text, (size_t)n, err);
}
