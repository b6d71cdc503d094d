/* libFuzzer: model files. What is read is a model, can be written, and reads back as the same. */
#include <math.h>
#include <stdlib.h>

#include "fuzz_file.h"
#include "mechkit/model.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct mk_model model, again;
    struct mk_error err = MK_ERROR_INIT;
    if (mk_model_read(fuzz_file(0, data, size), &model, &err) != MK_OK) {
        if (err.message[0] == '\0')
            abort();
        return 0;
    }
    const char *first = fuzz_scratch("first.ini"), *second = fuzz_scratch("second.ini");
    if (mk_model_write(first, &model, "a comment", &err) != MK_OK ||
        mk_model_read(first, &again, &err) != MK_OK ||
        mk_model_write(second, &again, "a comment", &err) != MK_OK ||
        !fuzz_same_files(first, second))
        abort();
    /* It can be evaluated at rest. */
    double x[MK_MAX_STATES], dx[MK_MAX_STATES];
    const double u[MK_MAX_INPUTS] = {0.0, 0.0}, v[MK_MAX_JOINTS] = {0.0, 0.0};
    mk_model_initial_state(&model, mk_plant(model.plant)->rest, v, x);
    mk_model_rhs(&model, 0.0, x, u, dx);
    return 0;
}
