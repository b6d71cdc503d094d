/* libFuzzer: command files, as `mechkit run --check` reads them. In a folder of its own: the only
 * file there that `source` can name is the file itself. */
#include <stdio.h>
#include <stdlib.h>

#include "console/script/cmd.h"
#include "console/script/cmdfile.h"
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
    static const struct cmd_known nothing;
    struct cmdfile *file = NULL;
    struct mk_error err = MK_ERROR_INIT;
    int errors = 0;
    const char *path = fuzz_scratch("commands");
    FILE *f = fopen(path, "wb");
    if (!f || fwrite(data, 1, size, f) != size || fclose(f) != 0)
        abort();
    enum mk_status st = cmdfile_read(path, &nothing, count_error, &errors, &file, &err);
    if ((st == MK_OK) != (errors == 0))
        abort();
    if (st == MK_OK) {
        (void)cmdfile_command_count(file);
        cmdfile_free(file);
    }
    return 0;
}
