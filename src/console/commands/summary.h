/* What happened in a run, from its log. */
#ifndef MECHKIT_CONSOLE_COMMANDS_SUMMARY_H
#define MECHKIT_CONSOLE_COMMANDS_SUMMARY_H

#include <stddef.h>

#include "console/commands/step_response.h"
#include "mechkit/log.h"
#include "mechkit/model.h"

#define SUMMARY_STEPS 8

/* One column of the command. */
struct summary_command {
    char name[10];    /* u, tau1, u_cmd ... */
    const char *unit; /* "": a command has none */
    double peak, rms; /* of the values that are there; NAN: there are none */
    size_t missing;   /* values that are not */
};

struct run_summary {
    char setup[40], rig[40];
    double seconds;
    double caught_t; /* first catch; NAN: never (or nothing to catch) */
    double held_s;   /* of the last stretch of balancing, up to its end */
    bool balanced_at_end;
    double rms[MK_MAX_JOINTS];  /* of that stretch, about its mean, from 1 s after the catch; NAN */
    bool slides[MK_MAX_JOINTS]; /* the joint's position is in m, else in rad */
    double track_rms; /* rms of motor speed against ref, over the last tenth; NAN: no reference */
    struct step_response step[SUMMARY_STEPS]; /* the first of them, of motor speed */
    size_t steps;                             /* all of them */
    struct summary_command command[MK_MAX_INPUTS];
    int commands;  /* 0: the log has no column for it */
    bool undriven; /* and says that there is none: nothing drives the rig */
    double late_max_us;
    size_t rows, lost;
    char fault[160]; /* "" : none */
};

MK_NODISCARD enum mk_status summarise(const char *path, struct run_summary *out,
                                      struct mk_error *err);
/* Unit of the position of joint j (0-based). */
const char *summary_unit(const struct run_summary *r, int j);
/* Unit of the reference that steps are given in. */
const char *summary_speed_unit(const struct run_summary *r);
/* One line for people; returns buf. */
const char *summary_line(const struct run_summary *r, char *buf, size_t size);

#endif
