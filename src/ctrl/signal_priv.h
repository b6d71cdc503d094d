/* The program that an expression is compiled to: a stack machine. */
#ifndef MECHKIT_CTRL_SIGNAL_PRIV_H
#define MECHKIT_CTRL_SIGNAL_PRIV_H

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

/* Compiles text into signal->code. */
enum mk_status mk_signal_parse(struct mk_signal *signal, const char *text, struct mk_error *err);

#endif
