#include "exchange/unit.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define COUNT(a) (sizeof(a) / sizeof(a)[0])

static const struct unit units[] = {
    {"s", QUANTITY_TIME, 1.0},
    {"ms", QUANTITY_TIME, 1e-3},
    {"us", QUANTITY_TIME, 1e-6},
    {"ns", QUANTITY_TIME, 1e-9},
    {"min", QUANTITY_TIME, 60.0},
    {"rad", QUANTITY_ANGLE, 1.0},
    {"mrad", QUANTITY_ANGLE, 1e-3},
    {"deg", QUANTITY_ANGLE, M_PI / 180.0},
    {"rev", QUANTITY_ANGLE, 2.0 * M_PI},
    {"rad/s", QUANTITY_SPEED, 1.0},
    {"deg/s", QUANTITY_SPEED, M_PI / 180.0},
    {"rev/s", QUANTITY_SPEED, 2.0 * M_PI},
    {"rpm", QUANTITY_SPEED, 2.0 * M_PI / 60.0},
    {"Nm", QUANTITY_TORQUE, 1.0},
    {"mNm", QUANTITY_TORQUE, 1e-3},
    {"m", QUANTITY_LENGTH, 1.0},
    {"cm", QUANTITY_LENGTH, 1e-2},
    {"mm", QUANTITY_LENGTH, 1e-3},
    {"um", QUANTITY_LENGTH, 1e-6},
    {"m/s", QUANTITY_SLIDING, 1.0},
    {"mm/s", QUANTITY_SLIDING, 1e-3},
    {"N", QUANTITY_FORCE, 1.0},
    {"kN", QUANTITY_FORCE, 1e3},
};

const struct unit *unit_by_name(const char *name)
{
    for (size_t i = 0; i < COUNT(units); i++)
        if (strcmp(units[i].name, name) == 0)
            return &units[i];
    return NULL;
}

bool unit_is_counts(const char *name)
{
    return strcmp(name, "counts") == 0;
}

enum quantity quantity_of_column(const char *name)
{
    static const struct {
        const char *name;
        enum quantity quantity;
    } known[] = {
        {"t", QUANTITY_TIME},          {"q1", QUANTITY_ANGLE},        {"q2", QUANTITY_ANGLE},
        {"dq1", QUANTITY_SPEED},       {"dq2", QUANTITY_SPEED},       {"u", QUANTITY_COMMAND},
        {"u1", QUANTITY_COMMAND},      {"u2", QUANTITY_COMMAND},      {"tau", QUANTITY_TORQUE},
        {"tau1", QUANTITY_TORQUE},     {"tau2", QUANTITY_TORQUE},     {"tau_cmd", QUANTITY_TORQUE},
        {"tau1_cmd", QUANTITY_TORQUE}, {"tau2_cmd", QUANTITY_TORQUE}, {"u_cmd", QUANTITY_COMMAND},
        {"u1_cmd", QUANTITY_COMMAND},  {"u2_cmd", QUANTITY_COMMAND}};
    for (size_t i = 0; i < COUNT(known); i++)
        if (strcmp(known[i].name, name) == 0)
            return known[i].quantity;
    return QUANTITY_NONE;
}

static enum quantity sliding(enum quantity quantity)
{
    switch (quantity) {
    case QUANTITY_ANGLE:
        return QUANTITY_LENGTH;
    case QUANTITY_SPEED:
        return QUANTITY_SLIDING;
    case QUANTITY_TORQUE:
        return QUANTITY_FORCE;
    default:
        return quantity;
    }
}

enum quantity quantity_of_joint_column(const char *name, const bool *linear, int motor)
{
    int joint = strchr(name, '1') ? 0 : strchr(name, '2') ? 1 : motor;
    enum quantity quantity = quantity_of_column(name);
    return linear[joint] ? sliding(quantity) : quantity;
}

const char *native_unit(enum quantity quantity)
{
    switch (quantity) {
    case QUANTITY_TIME:
        return "s";
    case QUANTITY_ANGLE:
        return "rad";
    case QUANTITY_SPEED:
        return "rad/s";
    case QUANTITY_TORQUE:
        return "Nm";
    case QUANTITY_LENGTH:
        return "m";
    case QUANTITY_SLIDING:
        return "m/s";
    case QUANTITY_FORCE:
        return "N";
    case QUANTITY_COMMAND:
    case QUANTITY_NONE:
        break;
    }
    return "";
}

const char *units_of(enum quantity quantity)
{
    switch (quantity) {
    case QUANTITY_TIME:
        return "s, ms, us, ns or min";
    case QUANTITY_ANGLE:
        return "rad, mrad, deg or rev";
    case QUANTITY_SPEED:
        return "rad/s, deg/s, rev/s or rpm";
    case QUANTITY_TORQUE:
        return "Nm or mNm";
    case QUANTITY_COMMAND:
        return "Nm or mNm (N or kN where the joint slides)";
    case QUANTITY_LENGTH:
        return "m, cm, mm or um";
    case QUANTITY_SLIDING:
        return "m/s or mm/s";
    case QUANTITY_FORCE:
        return "N or kN";
    case QUANTITY_NONE:
        break;
    }
    return "none";
}

double unit_size(const struct unit *unit, enum quantity quantity, double u_to_torque)
{
    if (unit->quantity == quantity)
        return unit->size;
    if (quantity == QUANTITY_COMMAND &&
        (unit->quantity == QUANTITY_TORQUE || unit->quantity == QUANTITY_FORCE) &&
        u_to_torque > 0.0)
        return unit->size / u_to_torque;
    return 0.0;
}
