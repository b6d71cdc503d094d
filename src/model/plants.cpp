// The plants as C sees them: the table of their rows, and what else they are asked.
#include "model/plants.hpp"

#include <cstring>
#include <string>

#include "model/plant_facts.h"

using namespace mk;

namespace
{

const mk_plant_info *const plants[] = {
#define MK_PLANT_ROW(P) &P::info,
    MK_PLANT_TABLE(MK_PLANT_ROW)
#undef MK_PLANT_ROW
};

// --- what a row must have ------------------------------------------------------------------------

constexpr bool joint_is_complete(const mk_plant_info &i, int j)
{
    bool endless = i.joint_travel[j] == HUGE_VAL;
    return i.joint_travel[j] > 0.0 && i.joint_speed[j] > 0.0 && endless == i.joint_is_wheel[j];
}

constexpr bool is_within(int low, int value, int high)
{
    return low <= value && value <= high;
}

constexpr bool counts_are_right(const mk_plant_info &i)
{
    return is_within(1, i.joints, MK_MAX_JOINTS) && is_within(0, i.motor_joint, i.joints - 1) &&
           is_within(3, i.parameter_count, MK_MAX_PARAMETERS) &&
           i.mass_count == i.parameter_count - 2 &&
           is_within(1, i.equilibrium_count, MK_MAX_EQUILIBRIA);
}

// A motor joint, limits of every joint, friction last, and somewhere to rest.
constexpr bool row_is_complete(const mk_plant_info &i)
{
    bool complete = i.name && i.help && i.source && counts_are_right(i);
    for (int j = 0; j < i.joints; j++)
        complete = complete && joint_is_complete(i, j);
    for (int k = 0; k < i.parameter_count; k++)
        complete = complete && i.parameter[k].name && i.parameter[k].unit && i.parameter[k].help;
    for (int k = 0; k < i.equilibrium_count; k++)
        complete = complete && i.equilibrium[k].name;
    return complete;
}

#define MK_PLANT_IS_COMPLETE(P)                                                                    \
    static_assert(P::joints == P::info.joints, "the law and the row of a plant disagree");         \
    static_assert(row_is_complete(P::info), "a plant's row lacks something");
MK_PLANT_TABLE(MK_PLANT_IS_COMPLETE)
#undef MK_PLANT_IS_COMPLETE

#define MK_PLANT_ONE(P) +1
static_assert(MK_PLANT_TABLE(MK_PLANT_ONE) == MK_PLANT_COUNT, "a kind of plant has no row");
#undef MK_PLANT_ONE

constexpr enum mk_plant_kind order[] = {
#define MK_PLANT_KIND(P) P::info.kind,
    MK_PLANT_TABLE(MK_PLANT_KIND)
#undef MK_PLANT_KIND
};
constexpr bool in_order()
{
    for (int k = 0; k < MK_PLANT_COUNT; k++)
        if (order[k] != k)
            return false;
    return true;
}
static_assert(in_order(), "the table of plants is in another order than enum mk_plant_kind");

std::string list_of_names()
{
    std::string list;
    for (int k = 0; k < MK_PLANT_COUNT; k++)
        list += std::string(k == 0 ? "" : k + 1 < MK_PLANT_COUNT ? ", " : " or ") + plants[k]->name;
    return list;
}

} // namespace

// --- rows ----------------------------------------------------------------------------------------

const mk_plant_info *mk_plant(enum mk_plant_kind kind)
{
    return static_cast<unsigned>(kind) < MK_PLANT_COUNT ? plants[kind] : nullptr;
}

const mk_plant_info *mk_plant_by_name(const char *name)
{
    for (const mk_plant_info *p : plants)
        if (name && strcmp(p->name, name) == 0)
            return p;
    return nullptr;
}

const char *mk_plant_names(void)
{
    static const std::string list = list_of_names();
    return list.c_str();
}

int mk_plant_parameter_index(const mk_plant_info *plant, const char *name)
{
    for (int i = 0; i < plant->parameter_count; i++)
        if (strcmp(plant->parameter[i].name, name) == 0)
            return i;
    return -1;
}

// --- what else plants are asked ------------------------------------------------------------------

double mk_plant_body_inertia(const mk_model *model, int joint)
{
    return with_plant(model->plant,
                      [&](auto plant) { return plant.body_inertia(model->parameter, joint); });
}

bool mk_plant_free_link(const mk_model *model, const double *x, mk_free_link *out)
{
    return with_plant(model->plant, [&](auto plant) {
        return plant.free_link(model->parameter, model->g, x, out);
    });
}

bool mk_plant_free_swing(const mk_model *model, mk_free_swing *out)
{
    return with_plant(model->plant,
                      [&](auto plant) { return plant.swing(model->parameter, model->g, out); });
}

int mk_plant_sketch(enum mk_plant_kind kind, const double *q, mk_stroke *out)
{
    return with_plant(kind, [&](auto plant) { return plant.sketch(q, out); });
}
