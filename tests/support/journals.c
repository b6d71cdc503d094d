#include "support/journals.h"

#include <check.h>

void read_journal_of(const char *folder, struct journal *out)
{
    struct mk_error err = MK_ERROR_INIT;
    bool found;
    ck_assert_msg(journal_open(out, folder, false, &found, &err) == MK_OK, "%s", err.message);
    journal_close(out);
    ck_assert(found);
}

const struct journal_finding *last_finding_of(const struct journal *journal)
{
    for (int i = journal->count - 1; i >= 0; i--)
        if (journal->experiment[i].finding.verdict[0])
            return &journal->experiment[i].finding;
    ck_abort_msg("nothing was learned");
    return NULL;
}
