/* Units of columns: what they are called and how large they are. */
#ifndef MECHKIT_EXCHANGE_UNIT_H
#define MECHKIT_EXCHANGE_UNIT_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

enum quantity {
    QUANTITY_NONE, /* counts, flags, whatever has no unit here */
    QUANTITY_TIME,
    QUANTITY_ANGLE,
    QUANTITY_SPEED,
    QUANTITY_TORQUE,
    QUANTITY_LENGTH,  /* these three where a joint slides */
    QUANTITY_SLIDING, /* its speed */
    QUANTITY_FORCE,
    QUANTITY_COMMAND /* a torque over u_to_torque */
};

struct unit {
    const char *name;
    enum quantity quantity;
    double size; /* in the log's own unit: s, rad, rad/s, N m, m, m/s, N */
};

/* NULL: there is no such unit. Upper and lower case count. */
const struct unit *unit_by_name(const char *name);
/* Whether a name of a unit means steps of an encoder, whose size is the rig's. */
bool unit_is_counts(const char *name);
/* What a column of a log holds, by its name (docs/formats.md, "Log"). */
enum quantity quantity_of_column(const char *name);
/* The same where joint j slides if linear[j] says so; `motor` (0-based) is the joint that a column
 * without a number means. */
enum quantity quantity_of_joint_column(const char *name, const bool *linear, int motor);
/* Unit that logs are in; "" for QUANTITY_NONE and QUANTITY_COMMAND. */
const char *native_unit(enum quantity quantity);
/* Names of the units of a quantity in a row, for messages. Static. */
const char *units_of(enum quantity quantity);
/* Size of `unit` in the unit of a log's column of that quantity; 0 when they do not go together, or
 * when it takes an u_to_torque that is not known (0). */
double unit_size(const struct unit *unit, enum quantity quantity, double u_to_torque);

#ifdef __cplusplus
}
#endif
#endif
