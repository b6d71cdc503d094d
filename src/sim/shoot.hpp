// Shooting: integrates a model over a stretch of a log from a given state and compares it with the
// readings, with derivatives of everything with respect to the start state and to parameters, of
// the numbers that are computed, or close to them (sim/shoot_columns.hpp). This is what fits are
// made of. Fixed steps
// (fourth-order Runge-Kutta between the edges of the command): a fit calls this thousands of times
// over data whose sampling already resolves the motion; tests hold it against the error-controlled
// solvers.
#ifndef MECHKIT_SIM_SHOOT_HPP
#define MECHKIT_SIM_SHOOT_HPP

#include <cstddef>

#include "mechkit/model.h"

namespace mk
{

constexpr int SHOOT_MAX_COLUMNS =
    MK_MAX_STATES + MK_MAX_PARAMETERS + MK_MAX_EFFECTS * MK_MAX_EFFECT_PARAMETERS;

// The log as the kernel sees it; arrays of `rows`.
struct ShootData {
    size_t rows;
    double start;                   // s from the start of the log to the first row here
    const double *t;                // s, from the first row here on
    const double *u[MK_MAX_INPUTS]; // held commands, no NaN; u[1] may be NULL
    const double *q[MK_MAX_JOINTS]; // readings
    const double *w[MK_MAX_JOINTS]; // weight of a reading (1 / standard deviation); 0: ignore it
};

// One call.
struct ShootTask {
    const mk_model *model;
    const ShootData *data;
    double begin, end; // s; readings taken in [begin, end), at `end` too if last
    bool last;
    // Of a run that nothing goes before: the readings of rows [first_row, end_row), no others. What
    // a late one shows of the time before `begin` is extrapolated from there. end_row 0: the
    // readings whose state lies between `begin` and `end`.
    size_t first_row, end_row;
    const double *x;   // start state, mk_model_state_count values
    double step;       // longest step, s
    bool edges_differ; // a command that says the same again takes no step of its own
    int free_count;    // parameters to differentiate by: numbers as in mechkit/ident.h
    const int *free;
    const double *scale; // derivatives are per scale[i] of the parameter

    bool close; // derivatives need not be those of the numbers that are computed, but of second
                // order in the step, for half the time

    // Results. Columns: start state (ns), then the free parameters.
    int columns;         // in: ns + free_count, or 0 for no derivatives
    double *x_end;       // ns
    double *jac_end;     // ns x columns, row-major
    size_t row_capacity; // readings that fit below
    size_t row_count;    // out
    double *residual;    // w (reading - predicted)
    double *jac;         // row_count x columns: w d(predicted)/d(column)
    int *joint_of;       // its joint, may be NULL
    long steps;          // out: integration steps taken
    bool finite;         // out: false when the trajectory ran away
};

// Runs tasks with the widest instructions of this machine, side by side where there are several.
// They share model, step, free parameters and number of columns. A task's result does not depend
// on the others, except that few and many differ in their last digits.
void shoot(ShootTask *tasks, int count);
inline void shoot(ShootTask &task)
{
    shoot(&task, 1);
}

// A'A of the rows of A (row-major, `columns` to a row) that are of one joint; joint_of nullptr: of
// all. By the widest instructions of this machine, so that the last digits are the machine's.
struct GramTask {
    const double *a;
    long rows;
    int columns; // at most GRAM_MAX_COLUMNS
    const int *joint_of;
    int joint;
};
constexpr int GRAM_MAX_COLUMNS = SHOOT_MAX_COLUMNS + 1; // derivatives, and a residual beside them
void gram(const GramTask &task, double *out);

// A kernel: how many tasks side by side. Its `run` differentiates by as many free parameters as it
// has room for, from first_free on, and returns how many.
struct ShootKernel {
    int width;
    int (*run)(ShootTask *tasks, int count, int first_free);
    void (*gram)(const GramTask &task, double *out); // nullptr where there are no derivatives
};

} // namespace mk
#endif
