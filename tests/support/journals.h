/* What an investigation has written down, for tests. */
#ifndef MK_TEST_JOURNALS_H
#define MK_TEST_JOURNALS_H

#include "investigate/journal.h"

/* The journal of the investigation in `folder`; fails the test where there is none. */
void read_journal_of(const char *folder, struct journal *out);
/* What was learned last; fails the test where nothing was. It lives as long as `journal`. */
const struct journal_finding *last_finding_of(const struct journal *journal);

#endif
