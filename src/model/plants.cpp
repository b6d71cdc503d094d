// The table of plants. Parameter values are the report's in command units (errata 2.1); the Furuta
// pendulum, which the report never measured, is the pendubot's links on a horizontal arm.
#include "mechkit/model.h"

#include <cmath>
#include <cstring>

namespace
{

constexpr double PI = 3.14159265358979323846;
constexpr double INF = HUGE_VAL;
constexpr double TINY = 1e-12; // "positive": an inertia of zero makes no mass matrix

const mk_plant_info plants[MK_PLANT_COUNT] = {
    {MK_PLANT_INERTIA_WHEEL,
     "inertia-wheel",
     "a wheel on the motor's shaft",
     "Meesters 2004 (2.1), (2.4)",
     1,
     0,
     {true, false},
     {MK_JOINT_EITHER, MK_JOINT_TURNS},
     {0.0, 0.0},
     3,
     {{"p1", "kg m^2", "inertia J of wheel and shaft", TINY, INF, 0.0045},
      {"p2", "N m s/rad", "viscous friction", 0.0, INF, 0.0112},
      {"p3", "N m", "Coulomb friction", 0.0, INF, 0.3487}},
     1,
     {{"rest", {0.0, 0.0}}}},
    {MK_PLANT_PENDULUM,
     "pendulum",
     "one link on the motor's shaft",
     "Meesters 2004 (3.13), (3.25)",
     1,
     0,
     {false, false},
     {MK_JOINT_TURNS, MK_JOINT_TURNS},
     {0.0, 0.0},
     4,
     {{"p1", "kg m^2", "inertia J about the shaft", TINY, INF, 0.0624},
      {"p2", "N m", "gravity torque m g l", 0.0, INF, 7.0408},
      {"p3", "N m s/rad", "viscous friction", 0.0, INF, 0.0111},
      {"p4", "N m", "Coulomb friction", 0.0, INF, 0.3575}},
     2,
     {{"hanging", {0.0, 0.0}}, {"top", {PI, 0.0}}}},
    {MK_PLANT_PENDUBOT,
     "pendubot",
     "two links, the motor at the shoulder",
     "Meesters 2004 (2.5), (2.6), (3.32)",
     2,
     0,
     {false, false},
     {MK_JOINT_TURNS, MK_JOINT_TURNS},
     {-PI / 2, 0.0},
     7,
     {{"p1", "kg m^2", "m1 lc1^2 + m2 L1^2 + J1", TINY, INF, 0.0540},
      {"p2", "kg m^2", "m2 lc2^2 + J2", TINY, INF, 0.0540},
      {"p3", "kg m^2", "m2 L1 lc2", -INF, INF, 0.0286},
      {"p4", "kg m", "m1 lc1 + m2 L1", -INF, INF, 0.7805},
      {"p5", "kg m", "m2 lc2", -INF, INF, 0.3284},
      {"p6", "N m s/rad", "viscous friction of the motor joint", 0.0, INF, 0.1346},
      {"p7", "N m", "Coulomb friction of the motor joint", 0.0, INF, 0.2014}},
     3,
     {{"hanging", {-PI / 2, 0.0}}, {"mid", {-PI / 2, PI}}, {"top", {PI / 2, 0.0}}}},
    {MK_PLANT_REACTION_WHEEL,
     "reaction-wheel",
     "a free pendulum that carries the motor with a wheel",
     "Meesters 2004 (2.19)-(2.21), section 3.4; errata 3.18",
     2,
     1,
     {false, true},
     {MK_JOINT_TURNS, MK_JOINT_TURNS},
     {0.0, 0.0},
     5,
     {{"p1", "kg m^2", "J1 + m1 lc1^2 + m2 L1^2", TINY, INF, 0.8544},
      {"p2", "kg m^2", "inertia of wheel and rotor", TINY, INF, 0.0045},
      {"p3", "kg m", "m1 lc1 + m2 L1", -INF, INF, 6.864},
      {"p4", "N m s/rad", "viscous friction of the motor", 0.0, INF, 0.0112},
      {"p5", "N m", "Coulomb friction of the motor", 0.0, INF, 0.3487}},
     2,
     {{"hanging", {0.0, 0.0}}, {"top", {PI, 0.0}}}},
    {MK_PLANT_FURUTA,
     "furuta",
     "a pendulum at the end of a horizontal arm on the motor's shaft",
     "Meesters 2004 (2.62), (2.63); errata 2.23, 2.24, 7.3",
     2,
     0,
     {false, false},
     {MK_JOINT_TURNS, MK_JOINT_TURNS},
     {0.0, PI},
     6,
     {{"p1", "kg m^2", "J1 + m1 lc1^2 + m2 L1^2 of the arm", TINY, INF, 0.0540},
      {"p2", "kg m^2", "2 m2 L1 lc2 (thin rod: m2 L1 L2)", -INF, INF, 0.0572},
      {"p3", "kg m^2", "(J2 + m2 lc2^2) / 4 (thin rod: J2)", TINY, INF, 0.0135},
      {"p4", "kg m", "m2 lc2", -INF, INF, 0.3284},
      {"p5", "N m s/rad", "viscous friction of the motor joint", 0.0, INF, 0.1346},
      {"p6", "N m", "Coulomb friction of the motor joint", 0.0, INF, 0.2014}},
     2,
     {{"hanging", {0.0, PI}}, {"top", {0.0, 0.0}}}},
};

} // namespace

const mk_plant_info *mk_plant(enum mk_plant_kind kind)
{
    return static_cast<unsigned>(kind) < MK_PLANT_COUNT ? &plants[kind] : nullptr;
}

const mk_plant_info *mk_plant_by_name(const char *name)
{
    for (const mk_plant_info &p : plants)
        if (name && strcmp(p.name, name) == 0)
            return &p;
    return nullptr;
}

int mk_plant_parameter_index(const mk_plant_info *plant, const char *name)
{
    for (int i = 0; i < plant->parameter_count; i++)
        if (strcmp(plant->parameter[i].name, name) == 0)
            return i;
    return -1;
}
