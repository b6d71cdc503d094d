// What a joint's unit means: the names of units, the size of a count, the sharpness of friction.
#include <cstring>

#include "mechkit/model.h"

namespace
{

constexpr double TURN = 6.283185307179586476925286766559; // rad
constexpr int USUAL_CPR = 4000;
constexpr double USUAL_RESOLUTION = 1e-6; // m, of a linear scale

// A unit of the tables for a joint that turns in SI, and the same for others: one that slides, and
// in units of the command one that turns, one that slides, one that turns where the command is a
// force.
struct UnitRow {
    const char *turns, *slides, *turns_command, *slides_command, *turns_by_force;
};
const UnitRow units[] = {
    {"rad", "m", "rad", "m", "rad"},
    {"mrad", "mm", "mrad", "mm", "mrad"},
    {"rad/s", "m/s", "rad/s", "m/s", "rad/s"},
    {"s/rad", "s/m", "s/rad", "s/m", "s/rad"},
    {"1/rad", "1/m", "1/rad", "1/m", "1/rad"},
    {"rad/s^2", "m/s^2", "rad/s^2", "m/s^2", "rad/s^2"},
    {"rad/s per sqrt(s)", "m/s per sqrt(s)", "rad/s per sqrt(s)", "m/s per sqrt(s)",
     "rad/s per sqrt(s)"},
    {"1/rev", "rad/m", "1/rev", "rad/m", "1/rev"},
    {"N m", "N", "u", "u", "u m"},
    {"N m/rad", "N/m", "u/rad", "u/m", "u m/rad"},
    {"N m s/rad", "N s/m", "u s/rad", "u s/m", "u m s/rad"},
    {"N m s^2/rad^2", "N s^2/m^2", "u s^2/rad^2", "u s^2/m^2", "u m s^2/rad^2"},
    {"kg m^2", "kg", "u s^2/rad", "u s^2/m", "u m s^2/rad"},
    {"kg m", "kg m", "u s^2/m", "u s^2", "u s^2"}};

bool slides(const mk_model *model, int joint)
{
    return model->joint_linear[joint < 0 ? mk_plant(model->plant)->motor_joint : joint];
}

double usual_sharpness(bool linear)
{
    return linear ? MK_FRICTION_SHARPNESS_SLIDING : MK_FRICTION_SHARPNESS_TURNING;
}

} // namespace

const char *mk_model_unit(const mk_model *model, int joint, const char *unit)
{
    bool linear = slides(model, joint), command = model->u_to_torque != 1.0;
    for (const UnitRow &row : units) {
        if (strcmp(unit, row.turns) != 0)
            continue;
        if (!command)
            return linear ? row.slides : row.turns;
        if (linear)
            return row.slides_command;
        return slides(model, -1) ? row.turns_by_force : row.turns_command;
    }
    return unit;
}

const char *mk_effect_parameter_unit(const mk_model *model, int joint,
                                     const mk_parameter_info *info)
{
    const bool angle = strcmp(info->unit, "rad") == 0 && (joint == 0 || info->fit == MK_FIT_ANGLE);
    return angle ? info->unit : mk_model_unit(model, joint - 1, info->unit);
}

enum mk_status mk_model_set_linear(mk_model *model, int joint, bool linear, mk_error *err)
{
    const mk_plant_info *plant = mk_plant(model->plant);
    enum mk_joint_motion motion = plant->joint_motion[joint];
    if (motion != MK_JOINT_EITHER && linear != (motion == MK_JOINT_SLIDES))
        return mk_error_set(err, MK_ERR_INVALID, "joint %d of the %s %s: its unit is %s", joint + 1,
                            plant->name, linear ? "turns" : "slides", linear ? "rad" : "m");
    model->joint_linear[joint] = linear;
    model->encoder_cpr[joint] = linear ? 0 : USUAL_CPR;
    model->encoder_resolution[joint] = linear ? USUAL_RESOLUTION : 0.0;
    if (joint == plant->motor_joint)
        model->friction_sharpness = usual_sharpness(linear);
    return MK_OK;
}

double mk_model_count(const mk_model *model, int joint)
{
    return model->encoder_resolution[joint] > 0.0 ? model->encoder_resolution[joint]
                                                  : TURN / model->encoder_cpr[joint];
}

double mk_model_sharpness(const mk_model *model, int joint)
{
    return joint == mk_plant(model->plant)->motor_joint
               ? model->friction_sharpness
               : usual_sharpness(model->joint_linear[joint]);
}

double mk_model_joint_scale(const mk_model *model, int joint)
{
    return MK_FRICTION_SHARPNESS_TURNING / usual_sharpness(model->joint_linear[joint]);
}

bool mk_model_turns_freely(const mk_model *model, int joint)
{
    return mk_plant(model->plant)->joint_is_wheel[joint] && !model->joint_linear[joint];
}
