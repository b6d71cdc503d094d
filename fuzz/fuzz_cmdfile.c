/* libFuzzer: command files, as `mechkit run --check` reads them. Files that `source` names are not
 * there. */
#include <stdlib.h>

#include "console/cmdfile.h"
#include "fuzz_file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void count_error(void *user, const struct mk_error *err)
{
    if (err->message[0] == '\0')
        abort();
    ++*(int *)user;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct cmdfile *file = NULL;
    struct mk_error err = MK_ERROR_INIT;
    int errors = 0;
    enum mk_status st = cmdfile_read(fuzz_file(0, data, size), count_error, &errors, &file, &err);
    if ((st == MK_OK) != (errors == 0))
        abort();
    if (st == MK_OK) {
        (void)cmdfile_command_count(file);
        cmdfile_free(file);
    }
    return 0;
}
