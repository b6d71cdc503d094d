/* The program that an expression is compiled to: a stack machine. */
#ifndef MECHKIT_CTRL_SIGNAL_PRIV_H
#define MECHKIT_CTRL_SIGNAL_PRIV_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/signal.h"

#define SIGNAL_MAX_OPS 512
#define SIGNAL_MAX_DEPTH 64 /* stack and nesting */

enum op {
    OP_NUMBER, /* pushes value */
    OP_TIME,   /* pushes t */
    OP_ADD,
    OP_SUB,
    OP_MUL,
    OP_DIV,
    OP_POW,
    OP_NEG,
    OP_CALL /* function: index into the table */
};

struct instruction {
    enum op op;
    int function;
    double value;
};

struct signal_function {
    const char *name;
    int arguments;
    const char *help;
    double (*call)(double t, const double *a);
    bool timed; /* depends on t as well as on its arguments */
};

extern const struct signal_function mk_signal_functions[];
extern const int mk_signal_function_count;

struct mk_signal {
    char *text;
    int count;
    struct instruction code[SIGNAL_MAX_OPS];
    struct mk_log *log; /* sampled signal: owns the data */
    const double *t, *u;
    size_t rows;
};

/* Runs a program that leaves one value. RT. */
double mk_signal_execute(const struct instruction *code, int count, double t);

/* Compiles text into signal->code; what does not depend on t is computed now. */
enum mk_status mk_signal_parse(struct mk_signal *signal, const char *text, struct mk_error *err);

#endif
