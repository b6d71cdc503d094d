/* libFuzzer: mapping files. What is read has numbers only, can be written, and reads back as the
 * same. */
#include <math.h>
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
    for (int i = 0; i < map.count; i++)
        if (!isfinite(map.column[i].sign) || !isfinite(map.column[i].offset))
            abort();
    if (!isfinite(map.u_to_torque) || map.encoder_cpr[0] < 0 || map.encoder_cpr[1] < 0)
        abort();
    const char *first = fuzz_scratch("first.map"), *second = fuzz_scratch("second.map");
    if (mk_import_map_write(first, &map, "a comment", &err) != MK_OK ||
        mk_import_map_read(first, &again, &err) != MK_OK ||
        mk_import_map_write(second, &again, "a comment", &err) != MK_OK ||
        !fuzz_same_files(first, second))
        abort();
    return 0;
}
