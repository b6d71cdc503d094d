// Foreign contact: stretches of measured logs in which something takes part that is not in the
// model of the rig, as somebody's hand, a kick, or a collision. docs/identification.md.
#ifndef MECHKIT_IDENT_CONTACT_HPP
#define MECHKIT_IDENT_CONTACT_HPP

#include <vector>

#include "mechkit/sim.h"

namespace mk
{

struct Contact {
    size_t log;          // number among the records
    double from_s, to_s; // from the log's first row on, with a margin; infinite at the log's ends
    int joint;           // 1-based: in whose equation the torque is missing
    double torque;       // largest in a block, torque units of the model
    double times;        // what is left there over the largest that is left anywhere else
};

// By log and time. A residual torque is foreign when it is out of all proportion to what remains
// anywhere else in these logs, and to what acts at that time: errors of a model come again wherever
// the rig does the same again, and are a part of what acts. Throws std::bad_alloc.
std::vector<Contact> find_contacts(const mk_model &model, const std::vector<mk_record> &records);

} // namespace mk
#endif
