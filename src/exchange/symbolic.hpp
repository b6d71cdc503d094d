// A model evaluated over expressions: its equations as a graph, ready to be written in another
// language.
#ifndef MECHKIT_EXCHANGE_SYMBOLIC_HPP
#define MECHKIT_EXCHANGE_SYMBOLIC_HPP

#include <string>
#include <vector>

#include "exchange/expr.hpp"
#include "mechkit/model.h"

namespace mk
{

// A number of the model that stays changeable where it is exported to.
struct ExportedParameter {
    std::string name; // an identifier: p1, backlash_width
    std::string unit, help;
    double value;
};

struct SymbolicModel {
    SymbolicModel() = default;
    SymbolicModel(const SymbolicModel &) = delete; // expressions point to its graph
    SymbolicModel &operator=(const SymbolicModel &) = delete;

    mk_model model;
    const mk_plant_info *plant;
    Graph graph;
    int joints, states, events;
    bool two_inputs;                    // joint 2 has a motor or a known torque too
    double command_delay;               // s
    double sensor_delay[MK_MAX_JOINTS]; // s
    std::vector<ExportedParameter> parameters;
    std::vector<std::string> state_names; // q1, q2, dq1, dq2, then the effects'
    // Over the variables t, the states, u1, u2 and the parameters:
    std::vector<Expr> dx, readings, surfaces, mass; // mass row-major joints x joints
    std::vector<Expr> at_rest; // state over q1, q2, dq1, dq2 with every effect at rest
};

void symbolic_model(const mk_model &model, SymbolicModel &out);

} // namespace mk
#endif
