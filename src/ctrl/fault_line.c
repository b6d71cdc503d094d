#include "ctrl/fault_line.h"

#include <stdio.h>

void mk_fault_line(enum mk_fault fault, int joint, double t, char out[MK_FAULT_LINE])
{
    char where[24] = "";
    if (joint > 0)
        snprintf(where, sizeof where, ", joint %d,", joint);
    snprintf(out, MK_FAULT_LINE, "%s%s at %.2f s", mk_fault_name(fault), where, t);
}
