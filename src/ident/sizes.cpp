#include "ident/sizes.hpp"

#include <cmath>

namespace mk
{

namespace
{

// No wheel turns a hundred thousand times in a run, and no amplifier is overdriven so far.
constexpr double MOST_ANGLE = 1e6;    // rad
constexpr double MOST_COMMAND = 10e3; // of u_max

enum mk_status check(const double *x, double most, const char *name, const char *unit,
                     const mk_log &log, mk_error *err)
{
    for (size_t k = 0; k < log.rows; k++) {
        const int line = log.first_row_line + (int)k;
        if (std::isinf(x[k]))
            return mk_error_at(err, MK_ERR_RANGE, log.path, line, 0,
                               "%s is infinite; a missing value is an empty field or nan", name);
        if (std::fabs(x[k]) > most)
            return mk_error_at(err, MK_ERR_RANGE, log.path, line, 0,
                               "%s is %.3g: no rig goes beyond %g%s; a missing value is an empty "
                               "field or nan",
                               name, x[k], most, unit);
    }
    return MK_OK;
}

} // namespace

enum mk_status check_angles(const double *x, const char *name, const mk_log &log, mk_error *err)
{
    return check(x, MOST_ANGLE, name, " rad", log, err);
}

enum mk_status check_commands(const double *x, const char *name, const mk_model &model,
                              const mk_log &log, mk_error *err)
{
    return check(x, MOST_COMMAND * model.u_max, name, ", ten thousand times the model's u_max", log,
                 err);
}

} // namespace mk
