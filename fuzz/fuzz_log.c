/* libFuzzer: logs. What is read can be written, and reads back as the same. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz_file.h"
#include "mechkit/log.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check_same(const struct mk_log *a, const struct mk_log *b)
{
    if (a->rows != b->rows || a->column_count != b->column_count)
        abort();
    for (size_t i = 0; i < a->column_count; i++) {
        const double *x = mk_log_get(a, a->columns[i].name);
        const double *y = mk_log_get(b, a->columns[i].name);
        if ((x == NULL) != (y == NULL))
            abort();
        for (size_t k = 0; x && k < a->rows; k++)
            if (x[k] != y[k] && !(isnan(x[k]) && isnan(y[k])))
                abort();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct mk_log *log, *again;
    struct mk_error err = MK_ERROR_INIT;
    if (mk_log_read(fuzz_file(0, data, size), &log, &err) != MK_OK) {
        if (err.message[0] == '\0')
            abort(); /* whoever refuses says why */
        return 0;
    }
    const char *path = fuzz_scratch("log.csv");
    if (mk_log_write(path, log, &err) == MK_OK) {
        if (mk_log_read(path, &again, &err) != MK_OK)
            abort();
        check_same(log, again);
        mk_log_free(again);
    }
    mk_log_free(log);
    return 0;
}
