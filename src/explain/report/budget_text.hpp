// The budget of the gap in report.html: a waterfall from the given model to the noise, and a table.
#ifndef MECHKIT_EXPLAIN_REPORT_BUDGET_TEXT_HPP
#define MECHKIT_EXPLAIN_REPORT_BUDGET_TEXT_HPP

#include <string>

#include "mechkit/explain.h"

namespace mk
{

std::string budget_html(const mk_explanation &e);

} // namespace mk
#endif
