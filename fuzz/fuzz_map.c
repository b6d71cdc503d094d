/* libFuzzer: mapping files. What is read can be written, and reads back as the same. */
#include <stdlib.h>

#include "fuzz_file.h"
#include "mechkit/exchange.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct mk_import_map map, again;
    struct mk_error err = MK_ERROR_INIT;
    if (mk_import_map_read(fuzz_file(0, data, size), &map, &err) != MK_OK) {
        if (err.message[0] == '\0')
            abort();
        return 0;
    }
    const char *first = fuzz_scratch("first.map"), *second = fuzz_scratch("second.map");
    if (mk_import_map_write(first, &map, "a comment", &err) != MK_OK ||
        mk_import_map_read(first, &again, &err) != MK_OK ||
        mk_import_map_write(second, &again, "a comment", &err) != MK_OK ||
        !fuzz_same_files(first, second))
        abort();
    return 0;
}
