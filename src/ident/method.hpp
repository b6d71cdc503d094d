// One identification method: a row of the table in identify.cpp.
#ifndef MECHKIT_IDENT_METHOD_HPP
#define MECHKIT_IDENT_METHOD_HPP

#include <memory>
#include <vector>

#include "mechkit/ident.h"

namespace mk
{

// What a method gets: columns found, the model checked, options filled in.
struct IdentProblem {
    mk_model model;
    std::vector<const mk_log *> logs;
    std::vector<std::shared_ptr<mk_log>> made; // of `logs`, copies in which rows are left out
    std::vector<mk_record> records;            // one a log
    bool moves[MK_MAX_JOINTS];                 // by more than a few counts in one log at least
    mk_ident_options options;
};

struct IdentMethod {
    mk_ident_method_info info;
    // Fills model, parameter[].value/std_error/..., covariance, condition numbers, cost, noise,
    // iterations, converged, rows and warnings; names, initial values, seconds are filled in by the
    // caller.
    enum mk_status (*fit)(const IdentProblem &problem, mk_ident_result &result, mk_error *err);
};

// A sentence that goes with a result; beyond as many as a result holds it is left out.
__attribute__((format(printf, 2, 3))) void warn(mk_ident_result &r, const char *format, ...);
void warn_if_not_excited(mk_ident_result &r, const mk_ident_parameter &p);

// The methods' rows, in the file that defines each.
extern const IdentMethod method_output_error;
extern const IdentMethod method_sls, method_wls, method_swevers, method_olsen, method_energy;

} // namespace mk
#endif
