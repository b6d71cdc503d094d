/* Options that `run` and `console` share, for a struct options with a `session`. */
#ifndef MECHKIT_CONSOLE_SCRIPT_SESSION_ARGS_H
#define MECHKIT_CONSOLE_SCRIPT_SESSION_ARGS_H

#include "console/commands/options.h"
#include "console/script/session.h"

/* Rows of a table; `model` and `fast` say what these two mean here. */
/* clang-format off */
#define SESSION_OPTIONS(model_help, fast_help)                                                     \
    {"board", OPTION_TEXT(session.board), "NAME",                                                  \
     "virtual (default), usb, parport, tcp, serial (docs/boards.md), null"},                       \
    {"device", OPTION_TEXT(session.device), "NAME",                                                \
     "which board, when there are several; with tcp HOST:PORT"},                                   \
    {"model", OPTION_TEXT(session.model), "M.ini", model_help},                                    \
    {"believe", OPTION_TEXT(session.believe), "M.ini",                                             \
     "what the controller believes; default: the same model"},                                     \
    {"fast", OPTION_FLAG(session.fast), NULL, fast_help},                                          \
    {"out", OPTION_OUTPUT(session.out), "DIR",                                                       \
     "where logs go; made if missing; default: the current directory"},                            \
    {"rate", OPTION_NUMBER(session.rate_hz), "HZ",                                                 \
     "samples per second, 100 .. 2000; default 500", MK_LOOP_RATE_MIN_HZ, MK_LOOP_RATE_MAX_HZ},    \
    {"stream", OPTION_FLAG(session.stream), NULL,                                                  \
     "samples by the board's clock (docs/boards.md)"},                                             \
    {"seed", OPTION_SEED(session.seed), "N", "of the virtual rig's noise; default 1", 0, 9e15}
/* clang-format on */

#endif
