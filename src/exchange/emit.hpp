// Expressions as statements of another language.
#ifndef MECHKIT_EXCHANGE_EMIT_HPP
#define MECHKIT_EXCHANGE_EMIT_HPP

#include <string>
#include <utility>
#include <vector>

#include "exchange/expr.hpp"

namespace mk
{

enum class Language { C, Octave };

struct Assignment {
    std::string target; // "dx[0]"
    Expr value;
};

const char *indent(Language language);

// Statements that carry out the assignments, a line each; what is needed more than once is computed
// once. Variables go by their names.
std::string statements(const Graph &graph, Language language,
                       const std::vector<Assignment> &assignments);

// Whether the variable `name` is needed by any of them.
bool needs(const Graph &graph, const std::vector<Assignment> &assignments, const std::string &name);

// A number as a literal of both languages that reads back as the same double.
std::string literal(double value);

} // namespace mk
#endif
