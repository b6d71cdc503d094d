#include "console/session_args.h"

#include "console/sub.h"
#include "mechkit/number.h"

static int number_arg(const char *command, const char *name, const char *text, double low,
                      double high, double *out)
{
    if (mk_parse_double_z(text, out) && *out >= low && *out <= high)
        return EXIT_OK;
    return report_usage(command, "--%s %s: expected a number from %g to %g", name, text, low, high);
}

bool session_take_arg(const char *command, int c, const char *value, struct session_options *o,
                      int *code)
{
    double x = 0.0;
    *code = EXIT_OK;
    switch (c) {
    case 'b':
        o->board = value;
        return true;
    case 'd':
        o->device = value;
        return true;
    case 'm':
        o->model = value;
        return true;
    case 'B':
        o->believe = value;
        return true;
    case 'o':
        o->out = value;
        return true;
    case 'f':
        o->fast = true;
        return true;
    case 'r':
        *code = number_arg(command, "rate", value, MK_LOOP_RATE_MIN_HZ, MK_LOOP_RATE_MAX_HZ,
                           &o->rate_hz);
        return true;
    case 's':
        *code = number_arg(command, "seed", value, 0, 9e15, &x);
        o->seed = (uint64_t)x;
        return true;
    default:
        return false;
    }
}
