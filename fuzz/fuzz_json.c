/* libFuzzer: JSON. What is read can be written, and reads back as the same. */
#include <stdlib.h>

#include "fuzz_file.h"
#include "mechkit/json.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cJSON *root, *again;
    struct mk_error err = MK_ERROR_INIT;
    if (mk_json_read(fuzz_file(0, data, size), &root, &err) != MK_OK) {
        if (err.message[0] == '\0')
            abort();
        return 0;
    }
    const char *first = fuzz_scratch("first.json"), *second = fuzz_scratch("second.json");
    if (mk_json_write(first, root, &err) != MK_OK || mk_json_read(first, &again, &err) != MK_OK ||
        mk_json_write(second, again, &err) != MK_OK || !fuzz_same_files(first, second))
        abort();
    cJSON_Delete(root);
    cJSON_Delete(again);
    return 0;
}
