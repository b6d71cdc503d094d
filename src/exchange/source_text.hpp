// Source text of a model in other languages (docs/matlab.md, "Models").
#ifndef MECHKIT_EXCHANGE_SOURCE_TEXT_HPP
#define MECHKIT_EXCHANGE_SOURCE_TEXT_HPP

#include <string>

#include "exchange/emit.hpp"
#include "exchange/symbolic.hpp"

namespace mk
{

// A function file for Octave and MATLAB.
std::string octave_source(const SymbolicModel &s, const std::string &name);
// A C header and source: equations, and an integrator to run them with.
std::string c_header(const SymbolicModel &s, const std::string &name);
std::string c_source(const SymbolicModel &s, const std::string &name);
// What an FMI 2.0 co-simulation unit is made of besides.
std::string fmu_source(const SymbolicModel &s, const std::string &name);
std::string fmu_description(const SymbolicModel &s, const std::string &name);

// `text` with every @WORD@ replaced; each pair is {"WORD", "what"}.
std::string fill(const char *text, const std::vector<std::pair<std::string, std::string>> &words);
std::string upper(const std::string &name);

// One line that says what the model is: the rig, and its effects.
std::string describe(const SymbolicModel &s);

} // namespace mk
#endif
