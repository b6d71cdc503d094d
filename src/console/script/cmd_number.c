/* Numbers as arguments of commands. */
#include <math.h>

#include "base/text.h"
#include "console/script/cmd_priv.h"
#include "mechkit/number.h"

#define SEED_MAX 9e15 /* whole numbers are exact up to there */

enum mk_status cmd_number(const char *text, double *out, struct mk_error *err)
{
    if (mk_parse_double_z(text, out) && isfinite(*out))
        return MK_OK;
    char comma[120];
    return mk_error_set(err, MK_ERR_PARSE, "'%s' is not a number%s", text,
                        mk_comma_text(text, comma, sizeof comma));
}

enum mk_status cmd_rate(const char *text, double *out, struct mk_error *err)
{
    double rate;
    enum mk_status st = cmd_number(text, &rate, err);
    if (st == MK_OK && !(rate >= MK_LOOP_RATE_MIN_HZ && rate <= MK_LOOP_RATE_MAX_HZ))
        st = mk_error_set(err, MK_ERR_RANGE, "rate %s: must be %g .. %g Hz", text,
                          MK_LOOP_RATE_MIN_HZ, MK_LOOP_RATE_MAX_HZ);
    if (st == MK_OK)
        *out = rate;
    return st;
}

enum mk_status cmd_seed(const char *text, uint64_t *out, struct mk_error *err)
{
    double seed;
    enum mk_status st = cmd_number(text, &seed, err);
    if (st == MK_OK && !(seed >= 0.0 && seed <= SEED_MAX && seed == floor(seed)))
        st = mk_error_set(err, MK_ERR_RANGE, "seed %s: must be a whole number from 0 to %g", text,
                          SEED_MAX);
    if (st == MK_OK)
        *out = (uint64_t)seed;
    return st;
}
