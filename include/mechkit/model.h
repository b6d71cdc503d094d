/* Models: a plant (equations of motion), its base parameters, and a list of effects.
 *
 * Plants and effects are tables; docs/theory.md has the equations, docs/adding.md how to add one.
 * A struct mk_model is plain memory: copy it by assignment, put it on the stack, compare it, pass
 * it to other threads. Nothing in it is owned. The evaluation functions are pure: RT-safe,
 * re-entrant.
 *
 * Units: angles rad, times s. Torques, and so the parameters, are in command units (torque divided
 * by u_to_torque) unless the rig's u_to_torque is 1, in which case they are SI. A joint that slides
 * (joint_linear) has metres for rad and newtons for N m: where this header says rad and torque of a
 * joint, read m and force there.
 *
 * State x: q[0..n-1], v[0..n-1] = dq/dt, then the states of the effects in order, n =
 * plant->joints.
 */
#ifndef MECHKIT_MODEL_H
#define MECHKIT_MODEL_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_MAX_JOINTS 2
#define MK_MAX_INPUTS 2
#define MK_MAX_PARAMETERS 8
#define MK_MAX_EFFECTS 12
#define MK_MAX_EFFECT_PARAMETERS 5
/* Base parameters, then those of the effects in order. */
#define MK_MAX_FIT_PARAMETERS (MK_MAX_PARAMETERS + MK_MAX_EFFECTS * MK_MAX_EFFECT_PARAMETERS)
#define MK_MAX_STATES 24
#define MK_MAX_EVENTS 24
/* Sharpness k of friction's sign S_k(v) = tanh(k v) where nothing else is said. A slide moves at
 * centimetres a second where a wheel turns at radians a second. */
#define MK_FRICTION_SHARPNESS_TURNING 15.0   /* s/rad; Meesters (2.3), errata 2.4 */
#define MK_FRICTION_SHARPNESS_SLIDING 1500.0 /* s/m */

/* --- plants --------------------------------------------------------------------------------- */

enum mk_plant_kind {
    MK_PLANT_INERTIA_WHEEL,
    MK_PLANT_PENDULUM,
    MK_PLANT_PENDUBOT,
    MK_PLANT_REACTION_WHEEL,
    MK_PLANT_FURUTA,
    MK_PLANT_CART_POLE,
    MK_PLANT_ACROBOT,
    MK_PLANT_COUNT
};

/* How a joint moves. */
enum mk_joint_motion {
    MK_JOINT_TURNS,  /* rad */
    MK_JOINT_SLIDES, /* m */
    MK_JOINT_EITHER  /* turns, or slides where the model says so: the law is the same for both */
};

/* How a fit treats a parameter. */
enum mk_parameter_fit {
    MK_FIT_FREE,
    MK_FIT_FIXED,   /* kept at its value: data hardly ever say anything about it */
    MK_FIT_INTEGER, /* tried value by value */
    MK_FIT_ANGLE,   /* phase, 2 pi periodic, of the effect's first parameter, an amplitude */
    MK_FIT_CENTRE /* position at which the torque of the effect's first parameter, a stiffness, is 0
                   */
};

/* Far beyond what any rig has in any unit; arithmetic with more than that ends in nonsense. */
#define MK_PARAMETER_MOST 1e9

struct mk_parameter_info {
    const char *name; /* "p1", or an effect's "width" */
    const char *unit; /* SI text; "" for none. Command units divide torques by u_to_torque. */
    const char *help; /* one line: what it is physically */
    double min, max;  /* physical range, inclusive; +-MK_PARAMETER_MOST where open */
    double initial;   /* a usual value (effects: where a search starts; plants: Meesters') */
#ifdef __cplusplus
    enum mk_parameter_fit fit = MK_FIT_FREE;
    bool optional = false; /* left out of a model file it is `initial` */
    unsigned plants = 0;   /* bits (1u << enum mk_plant_kind) of the plants on which it does
                            * something, by their rows; 0: all */
#else
    enum mk_parameter_fit fit;
    bool optional;
    unsigned plants;
#endif
};

struct mk_equilibrium {
    const char *name;        /* "hanging", "mid", "top" */
    double q[MK_MAX_JOINTS]; /* rad */
    const char *setup;       /* the set-up that holds it (mechkit/ctrl.h); NULL: none does */
};

#define MK_MAX_EQUILIBRIA 3
#define MK_MAX_PLANT_NAMES 4

/* One row of the table of plants: what only this plant knows. Lists of names end with NULL. */
struct mk_plant_info {
    enum mk_plant_kind kind;
    const char *name;                   /* as in [rig] kind */
    const char *help;                   /* one line */
    const char *source;                 /* equation in the report, errata */
    int joints;                         /* 1 or 2 */
    int motor_joint;                    /* 0-based joint that the motor drives */
    bool joint_is_wheel[MK_MAX_JOINTS]; /* turns without end; its angle has no meaning by itself */
    /* Gravity does nothing at it, so that it rests anywhere: an arm that turns level, a carriage on
     * its track. */
    bool joint_is_level[MK_MAX_JOINTS];
    /* Joint 2's axis is parallel to joint 1's: body 2 stands in space at q1 + q2, and what turns it
     * against body 1 acts back on body 1. */
    bool joints_parallel;
    enum mk_joint_motion joint_motion[MK_MAX_JOINTS];
    /* Beyond these the safety limits stop a run unless they are told otherwise: how far from its
     * rest, either way, and how fast, in the joint's unit; of MK_JOINT_EITHER in rad, and times
     * mk_model_joint_scale. INFINITY: turns without end. */
    double joint_travel[MK_MAX_JOINTS];
    double joint_speed[MK_MAX_JOINTS];
    double rest[MK_MAX_JOINTS]; /* hanging rest: what the counters are zeroed at, rad */
    /* What is balanced leans from upright by the sum of lean[j] (q[j] - q_top[j]), q_top the last
     * equilibrium. All 0: nothing is balanced. */
    double lean[MK_MAX_JOINTS];
    double u_max, u_to_torque; /* of a model that does not say; 0: those of struct mk_model */
    /* The first mass_count parameters are sums of masses, lengths and inertias. Behind them stand
     * the two of the motor joint's friction, viscous and then Coulomb, and no more. */
    int parameter_count, mass_count;
    struct mk_parameter_info parameter[MK_MAX_PARAMETERS];
    int parameter_joint[MK_MAX_PARAMETERS]; /* 0-based joint in whose unit it is: mk_model_unit */
    const char *mass_rule; /* which parameters make a mass matrix, in words; NULL: all in range */
    int equilibrium_count;
    struct mk_equilibrium equilibrium[MK_MAX_EQUILIBRIA];
    const char *unsuited[MK_MAX_PLANT_NAMES]; /* effects that make no sense on it */
    const char *measures[MK_MAX_PLANT_NAMES]; /* measurements that it allows (mechkit/measure.h) */
    /* Parameters of effects that do something on it, and nothing on a plant that does not list
     * them. */
    const char *own[MK_MAX_PLANT_NAMES];
};

/* The row of a plant; NULL out of range. Static. */
const struct mk_plant_info *mk_plant(enum mk_plant_kind kind);
/* The plant of that name; NULL: unknown, or no name. Static. */
const struct mk_plant_info *mk_plant_by_name(const char *name);
/* The names of all, as a message lists them: "inertia-wheel, pendulum or furuta". Static. */
const char *mk_plant_names(void);

/* --- effects -------------------------------------------------------------------------------- */

enum mk_effect_joint {
    MK_EFFECT_JOINT_NONE,    /* acts on the rig: no joint in the file, `joint` is 0 */
    MK_EFFECT_JOINT_ANY,     /* `joint` 1..plant joints */
    MK_EFFECT_JOINT_OPTIONAL /* 1..joints, or left out for "all" */
};

/* What of a model an effect touches; a set of flags. */
enum mk_effect_stage {
    MK_STAGE_COMMAND = 1,      /* between the command and the motor's torque */
    MK_STAGE_TORQUE = 2,       /* adds torque at a joint */
    MK_STAGE_INERTIA = 4,      /* changes the mass matrix */
    MK_STAGE_STATE = 8,        /* owns states */
    MK_STAGE_EVENT = 16,       /* has surfaces where its law switches */
    MK_STAGE_MEASUREMENT = 32, /* between the true angles and the readings */
    MK_STAGE_FRAME = 64,       /* moves or tilts the base */
    MK_STAGE_COMMAND_DELAY = 128,
    MK_STAGE_SENSOR_DELAY = 256
};

/* One row of the table of effects (the vocabulary of docs/effects.md). */
struct mk_effect_info {
    const char *name;
    const char *help;   /* the law in one line */
    const char *source; /* reference */
    enum mk_effect_joint joint_rule;
    unsigned stages; /* enum mk_effect_stage */
    unsigned plants; /* bit (1u << enum mk_plant_kind): where it makes sense, by the plants' rows */
    int state_count;
    int event_count;
    int parameter_count;
    struct mk_parameter_info parameter[MK_MAX_EFFECT_PARAMETERS];
    /* invertible: a command can cancel it at once, wherever it acts on the motor joint.
     * holds_still: dry friction, that can hold a joint where it is, by its parameter `level`. */
#ifdef __cplusplus
    bool invertible = false, holds_still = false;
#else
    bool invertible, holds_still;
#endif
};

/* An effect in words, for people; NULL: it has none, as terms of the library have not. */
struct mk_effect_words {
    const char *title;  /* what the field calls it, without a verb: "Stribeck friction" */
    const char *usual;  /* what usually causes it: a sentence, or what could be one */
    const char *remedy; /* what to do about it, or how to be sure: a sentence */
};

/* How many effects there are: indices 0 .. count - 1. */
int mk_effect_count(void);
const struct mk_effect_info *mk_effect(int index); /* NULL out of range; static */
/* The effect of that name; NULL: unknown, or no name. Static. */
const struct mk_effect_info *mk_effect_by_name(const char *name);
const struct mk_effect_words *mk_effect_in_words(const struct mk_effect_info *effect); /* static */

/* One effect in a model. */
struct mk_effect_use {
    int index; /* into the table: mk_effect(index) */
    int joint; /* 1-based as in the file; 0: none, or all */
    double value[MK_MAX_EFFECT_PARAMETERS];
    /* Standard deviation, from log to log, of the values that logs have of their own about
     * value[i], in its unit (a random effect: Pinheiro and Bates 2000). 0: all logs share one. */
    double spread[MK_MAX_EFFECT_PARAMETERS];
};

/* Which of a log's columns drives the model, where the log has both the command that was sent and
 * what a drive measured of it (docs/formats.md, "Log"). */
enum mk_input {
    MK_INPUT_UNSAID,    /* nobody has said it: the measured column */
    MK_INPUT_MEASURED,  /* u, tau, u1/u2, tau1/tau2 */
    MK_INPUT_COMMANDED, /* the same names with _cmd */
    MK_INPUT_COUNT
};
const char *mk_input_name(enum mk_input input); /* "measured" (also where unsaid), "commanded" */

/* --- a model -------------------------------------------------------------------------------- */

struct mk_model {
    enum mk_plant_kind plant;
    double g;                         /* m/s^2, default 9.81 */
    double u_max;                     /* limit of the command, default 10; > 0 */
    double u_to_torque;               /* N m per unit of command, default 0.00494; > 0 */
    bool joint_linear[MK_MAX_JOINTS]; /* slides: m, N; see mk_model_set_linear */
    double friction_sharpness;        /* of the motor joint's own Coulomb friction, s/rad or s/m */
    /* An encoder by counts per revolution (default 4000), or by the size of a count in the joint's
     * unit: one of the two, the other is 0. mk_model_count reads them. */
    int encoder_cpr[MK_MAX_JOINTS];
    double encoder_resolution[MK_MAX_JOINTS];
    double parameter[MK_MAX_PARAMETERS];
    double parameter_stderr[MK_MAX_PARAMETERS]; /* 0: unknown */
    int effect_count;
    struct mk_effect_use effect[MK_MAX_EFFECTS];
    double rtol, atol; /* integration tolerances, defaults 1e-8, 1e-10 */
    bool no_motor;     /* nothing drives the rig: its logs need no command, which is 0 */
    enum mk_input input;
};

/* A model of `kind` with Meesters' parameters, defaults elsewhere, and no effects. */
void mk_model_default(enum mk_plant_kind kind, struct mk_model *out);

/* Reads a model file (docs/formats.md, "Model"). Errors name file, line and key: MK_ERR_NOTFOUND,
 * MK_ERR_IO, MK_ERR_PARSE (syntax, unknown section, key, kind or effect, missing parameter, a key
 * twice), MK_ERR_RANGE (value outside its physical range, or parameters that make no mass matrix).
 */
MK_NODISCARD enum mk_status mk_model_read(const char *path, struct mk_model *out,
                                          struct mk_error *err);
/* The same for who can do without some values: of a parameter that the file says is `?` *out has a
 * usual value and unknown[number] (MK_MAX_FIT_PARAMETERS of them, base parameters first, then those
 * of the effects in order) is true. mk_model_read refuses `?`: MK_ERR_RANGE. */
MK_NODISCARD enum mk_status mk_model_read_open(const char *path, struct mk_model *out,
                                               bool *unknown, struct mk_error *err);
/* Writes it, atomically; reads back equal. `comment` (may be NULL, may have several lines) goes on
 * top as # lines. MK_ERR_IO, MK_ERR_NOSPACE, MK_ERR_PERM. */
MK_NODISCARD enum mk_status mk_model_write(const char *path, const struct mk_model *model,
                                           const char *comment, struct mk_error *err);

/* Checks ranges and that the mass matrix is positive definite everywhere. MK_ERR_RANGE. */
MK_NODISCARD enum mk_status mk_model_check(const struct mk_model *model, struct mk_error *err);

/* Appends an effect with its initial values. `joint` 1-based, 0 for none. MK_ERR_NOTFOUND (name),
 * MK_ERR_INVALID (joint or plant do not fit), MK_ERR_RANGE (too many). */
MK_NODISCARD enum mk_status mk_model_add_effect(struct mk_model *model, const char *name, int joint,
                                                struct mk_error *err);

/* Whether a parameter may have a value of its own in every log: no count, no phase, no constant. */
bool mk_parameter_may_differ(const struct mk_parameter_info *info);
/* Whether it does something on rigs of this kind. */
bool mk_parameter_applies(const struct mk_parameter_info *info, enum mk_plant_kind plant);
/* Whether nobody needs to be told of it: a constant of a law that follows from the rig where
 * nothing else is said, as the sharpness of a friction, and what does nothing on this kind of rig.
 */
bool mk_parameter_goes_without_saying(const struct mk_parameter_info *info,
                                      enum mk_plant_kind plant);
/* Whether some parameter of the model has (a spread above 0). */
bool mk_model_has_own_values(const struct mk_model *model);

/* Lets `joint` (0-based) slide or turn, and sets what depends on its unit (count, friction's
 * sharpness) to the defaults. Before effects are added. MK_ERR_INVALID where the plant's joint does
 * not move so. */
enum mk_status mk_model_set_linear(struct mk_model *model, int joint, bool linear,
                                   struct mk_error *err);
/* Size of one count of a joint's encoder (0-based), in the joint's unit. RT-safe. */
double mk_model_count(const struct mk_model *model, int joint);
/* Sharpness k of S_k(v) at a joint (0-based) for laws that do not say another: the model's own at
 * the motor joint, the default of the unit elsewhere. RT-safe. */
double mk_model_sharpness(const struct mk_model *model, int joint);
/* Size of a motion, in the joint's unit, that is what 1 rad is to a joint that turns: from the
 * defaults of friction's sharpness. For thresholds and starting values. RT-safe. */
double mk_model_joint_scale(const struct mk_model *model, int joint);
/* Whether a joint (0-based) turns without end, so that its angle has no meaning by itself. RT-safe.
 */
bool mk_model_turns_freely(const struct mk_model *model, int joint);
/* A unit of the tables, written for a joint that turns in SI ("N m s/rad", "rad/s", "mrad"), for
 * `joint` (0-based; -1: the rig, i.e. its motor joint) of this model: "N s/m" where it slides; "u"
 * for torques where the model is in units of the command ("u s/rad"; "u m s/rad" at a joint that
 * turns where the motor's slides). Static text. RT-safe. */
const char *mk_model_unit(const struct mk_model *model, int joint, const char *unit);
/* The unit of an effect's parameter at `joint` (1-based; 0: the rig). A phase is an angle wherever
 * it stands, and so is that of the base. Static text. RT-safe. */
const char *mk_effect_parameter_unit(const struct mk_model *model, int joint,
                                     const struct mk_parameter_info *info);

/* Index of parameter `name` of the plant; -1: none. */
int mk_plant_parameter_index(const struct mk_plant_info *plant, const char *name);
/* Index of parameter `name` of an effect; -1: none. */
int mk_effect_parameter_index(const struct mk_effect_info *effect, const char *name);

/* --- evaluation (all RT-safe) --------------------------------------------------------------- */

/* Joints of the plant, 1 .. MK_MAX_JOINTS. */
int mk_model_joints(const struct mk_model *model);
int mk_model_state_count(const struct mk_model *model); /* 2 * joints + states of effects */
/* Switching functions of all effects: values that mk_model_events writes. */
int mk_model_event_count(const struct mk_model *model);
/* Whether an effect puts something with states of its own between a joint and its encoder, so that
 * readings show the far side only (backlash). */
bool mk_model_hides_joint(const struct mk_model *model);
bool mk_model_is_smooth(const struct mk_model *model);       /* no effect has states or events */
double mk_model_command_delay(const struct mk_model *model); /* s; 0 without such an effect */

/* State at true joint angles q and speeds v (joints values each) with every effect at rest. */
void mk_model_initial_state(const struct mk_model *model, const double *q, const double *v,
                            double *x);

/* dx/dt at time t under command u. u[0] is the motor's command, limited to +-u_max; u[1] a known
 * torque on joint 2 of a rig with two motors (0 otherwise). Delays are not applied here: the
 * simulation shifts u. */
void mk_model_rhs(const struct mk_model *model, double t, const double *x, const double *u,
                  double *dx);

/* Values of the switching functions: an event is a sign change. */
void mk_model_events(const struct mk_model *model, double t, const double *x, const double *u,
                     double *g);

/* Angles as the encoders would read them, before quantisation (encoder effects applied; sensor
 * delays are the simulation's). */
void mk_model_measure(const struct mk_model *model, double t, const double *x, double *y);
/* True joint angles for a reading: the inverse of mk_model_measure for effects without state. */
void mk_model_unmeasure(const struct mk_model *model, double t, const double *y, double *q);

/* The textbook plant alone (no effects) ------------------------------------------------------- */

/* Generalised forces D a + C v + G + friction that a motion (q, v, a) needs: n values; row j is the
 * equation of joint j in Lagrangian form, whose right-hand side is the motor's command at the motor
 * joint and 0 elsewhere. Equal to Phi p. */
void mk_plant_inverse_dynamics(const struct mk_model *model, const double *q, const double *v,
                               const double *a, double *tau);
/* Regressor Phi, row-major joints x parameter_count: inverse dynamics = Phi p. */
void mk_plant_regressor(const struct mk_model *model, const double *q, const double *v,
                        const double *a, double *phi);
/* Mass matrix (row-major n x n) and h = C v + G + friction (n). */
void mk_plant_mass(const struct mk_model *model, const double *q, const double *v, double *mass,
                   double *h);
/* Accelerations under generalised forces tau (n). */
void mk_plant_acceleration(const struct mk_model *model, const double *q, const double *v,
                           const double *tau, double *a);
/* Kinetic energy, in torque units x rad. */
double mk_plant_kinetic(const struct mk_model *model, const double *q, const double *v);
/* Potential energy in the same unit; 0 as in docs/theory.md. */
double mk_plant_potential(const struct mk_model *model, const double *q);
/* Friction torque of the motor joint at speed v: what the plant's own two friction parameters say.
 */
double mk_plant_friction(const struct mk_model *model, double v);

/* Linearisation of the plant (without its friction unless `friction`) at (q, v = 0) under the
 * motor command that holds it there: A row-major 2n x 2n, B 2n, state order [q1 .. qn v1 .. vn]. */
void mk_plant_linearise(const struct mk_model *model, const double *q, bool friction, double *a_out,
                        double *b_out);

/* Jacobians of the whole model, effects included, by automatic differentiation of the same source:
 * dfdx row-major ns x ns, dfdu row-major ns x 2, dfdp row-major ns x np (base parameters, then the
 * effects' in order). Any output may be NULL. */
void mk_model_jacobian(const struct mk_model *model, double t, const double *x, const double *u,
                       double *dfdx, double *dfdu, double *dfdp);
int mk_model_parameter_count(const struct mk_model *model); /* base + effects */

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
