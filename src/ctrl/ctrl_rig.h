/* Which rigs a setup is for. */
#ifndef MECHKIT_CTRL_RIG_H
#define MECHKIT_CTRL_RIG_H

#include "mechkit/ctrl.h"

/* MK_ERR_INVALID says which rigs it is for. */
MK_NODISCARD enum mk_status mk_ctrl_check_rig(const struct mk_ctrl_ops *ops, enum mk_plant_kind rig,
                                              struct mk_error *err);
/* The first rig in the table of plants that it is for. */
enum mk_plant_kind mk_ctrl_first_rig(const struct mk_ctrl_ops *ops);

#endif
