/* What happened in a run, from its log. */
#ifndef MECHKIT_CONSOLE_COMMANDS_SUMMARY_H
#define MECHKIT_CONSOLE_COMMANDS_SUMMARY_H

#include <stddef.h>

#include "console/commands/step_response.h"
#include "mechkit/log.h"
#include "mechkit/model.h"

#define SUMMARY_STEPS 8

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
    double u_peak, u_rms;
    double late_max_us;
    size_t rows, lost;
    char fault[160]; /* "" : none */
};

MK_NODISCARD enum mk_status summarise(const char *path, struct run_summary *out,
                                      struct mk_error *err);
/* Unit of the position of joint j (0-based). */
const char *summary_unit(const struct run_summary *r, int j);
/* One line for people; returns buf. */
/* Unit of the reference that steps are given in. */
const char *summary_speed_unit(const struct run_summary *r);
const char *summary_line(const struct run_summary *r, char *buf, size_t size);

#endif
