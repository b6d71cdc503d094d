// Cases with a hidden effect, drawn from a seed: rigs, sizes, inputs and noise vary widely.
#ifndef MECHKIT_TESTS_CASES_HPP
#define MECHKIT_TESTS_CASES_HPP

#include <memory>

#include "ident/owned_log.hpp"
#include "mechkit/log.h"
#include "mechkit/model.h"
#include "support/truth.hpp"

namespace truth
{

using mk::OwnedLog;

struct Name {
    std::string effect;
    int joint; // 0: any
};

struct Case {
    std::string kind; // none, parameters, single, pair, several, off
    Rig rig;          // the truth
    mk_model given;
    std::vector<std::vector<Name>> right; // by hidden effect: its name, and what is the same thing
    std::vector<Recording> how;           // the last one is held out
    std::vector<OwnedLog> train;
    OwnedLog holdout;
};

// What is wanted; empty strings and 0: drawn too.
struct Wish {
    std::string rig, kind, effect;
    int joint = 0;
    double size = 1.0; // times the usual size
    uint64_t seed = 1;
    bool logs = true; // false: the rig and its effects alone
    // 0: as is usual
    double rate = 0.0, seconds = 0.0; // Hz; of each log
    size_t runs = 0;                  // logs, the last one held out
    // 1 at least: by how much ranges of sizes and shapes are wider at both ends. The usual ones are
    // what searches start from, more or less; what has been tuned to them shows in wider ones.
    double stretch = 1.0;
};
Case make_case(const Wish &wish);

OwnedLog as_log(const Log &made, const Rig &rig, const Recording &how);
// 4 s at 250 Hz of a rig with the usual parameters and these effects: a multisine where the seed is
// odd, else a chirp, unless another input is named.
OwnedLog usual_log(enum mk_plant_kind kind, const std::vector<Effect> &effects, uint64_t seed,
                   const char *input = nullptr);
// Names of effects that can hide in a rig (catalogue entries only).
std::vector<std::string> hideable(const std::string &rig);
extern const std::vector<std::string> rig_kinds;

} // namespace truth
#endif
