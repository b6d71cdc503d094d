/* A fault as a line for people. */
#ifndef MECHKIT_CTRL_FAULT_LINE_H
#define MECHKIT_CTRL_FAULT_LINE_H

#include "mechkit/safety.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MK_FAULT_LINE 64

/* "jump, joint 2, at 1.25 s"; joint 0, a fault of no joint, is not named: "link at 1.25 s". */
void mk_fault_line(enum mk_fault fault, int joint, double t, char out[MK_FAULT_LINE]);

#ifdef __cplusplus
}
#endif
#endif
