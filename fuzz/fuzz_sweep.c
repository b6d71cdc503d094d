/* libFuzzer: spec files of sweeps. Every run of what is read has a point and values. In a folder of
 * its own: among the descriptors of the process, a model could be a pipe that nobody writes to. */
#include <stdio.h>
#include <stdlib.h>

#include "experiment/sweep.h"
#include "fuzz_file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct sweep s;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = fuzz_scratch("sweep.ini");
    FILE *f = fopen(path, "wb");
    if (!f || fwrite(data, 1, size, f) != size || fclose(f) != 0)
        abort();
    enum mk_status st = sweep_read(path, &s, &err);
    if (st == MK_OK) {
        if (s.total < 1 || s.total > SWEEP_RUNS_MAX)
            abort();
        for (int i = 0; i < s.axis_count; i++)
            if (sweep_at(&s, 0, i) != 0 || sweep_at(&s, s.total - 1, i) != s.axis[i].count - 1)
                abort();
    } else if (err.message[0] == '\0') {
        abort();
    }
    sweep_free(&s);
    return 0;
}
