/* libFuzzer: JSON. What is read can be written, and reads back as the same; numbers that we write
 * read back to the last bit. cJSON, which parses, is a library the fuzzer cannot look into: what it
 * made of the text, or where it stopped, tells instead. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz_file.h"
#include "fuzz_seen.h"
#include "mechkit/json.h"

#define NUMBERS 64

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Kinds of characters that are read, and written, in ways of their own. */
static uint32_t kind_of(uint8_t c)
{
    if (c < 0x20)
        return c;
    if (strchr("\"\\/{}[]:,+-.eEunrtbf", c))
        return c;
    return c < 0x7f ? (c >= '0' && c <= '9' ? '0' : 'a') : 0x80u + (c >> 3);
}

static void look_at_text(uint32_t where, const char *text)
{
    uint8_t before = 0;
    fuzz_seen(where << 16 | 1u << 12 | fuzz_size(strlen(text)));
    for (; *text; text++) {
        fuzz_seen(where << 16 | 2u << 12 | kind_of(before) << 4 | kind_of((uint8_t)*text));
        before = (uint8_t)*text;
    }
}

static void look_at(const cJSON *item, uint32_t depth, uint32_t parent)
{
    uint32_t type = (uint32_t)item->type & 0xff, n = 0;
    uint32_t where =
        (depth < 15 ? depth : 15) << 8 | (fuzz_size(parent) & 15) << 4 | fuzz_size(type);
    if (item->string)
        look_at_text(1, item->string);
    if (cJSON_IsString(item))
        look_at_text(2, item->valuestring);
    if (cJSON_IsNumber(item)) {
        int exponent = 0;
        frexp(item->valuedouble, &exponent);
        fuzz_seen(3u << 16 | (uint32_t)(exponent + 2048) << 2 |
                  (uint32_t)(signbit(item->valuedouble) != 0) << 1 |
                  (uint32_t)(item->valuedouble == floor(item->valuedouble)));
    }
    for (const cJSON *child = item->child; child; child = child->next, n++)
        look_at(child, depth + 1, type);
    fuzz_seen(4u << 16 | where << 4 | fuzz_size(n));
}

static void look_at_error(const struct mk_error *err, const uint8_t *data, size_t size)
{
    int line = 1;
    size_t i = 0;
    for (; i < size && line < err->line; i++)
        line += data[i] == '\n';
    i += err->column > 0 ? (size_t)err->column - 1 : 0;
    fuzz_seen(5u << 16 | kind_of(i > 0 && i - 1 < size ? data[i - 1] : 0) << 8 |
              kind_of(i < size ? data[i] : 0));
    fuzz_seen(6u << 16 | fuzz_size(i));
}

static void write_and_read(cJSON *root)
{
    cJSON *again;
    struct mk_error err = MK_ERROR_INIT;
    const char *first = fuzz_scratch("first.json"), *second = fuzz_scratch("second.json");
    if (mk_json_write(first, root, &err) != MK_OK || mk_json_read(first, &again, &err) != MK_OK ||
        mk_json_write(second, again, &err) != MK_OK || !fuzz_same_files(first, second))
        abort();
    cJSON_Delete(again);
}

/* The bytes as doubles: what there is of reports that is our own. */
static void numbers(const uint8_t *data, size_t size)
{
    double value[NUMBERS];
    cJSON *again;
    struct mk_error err = MK_ERROR_INIT;
    size_t n = size / sizeof *value, i = 0;
    n = n < NUMBERS ? n : NUMBERS;
    memcpy(value, data, n * sizeof *value);
    cJSON *root = mk_json_numbers(value, n);
    const char *path = fuzz_scratch("numbers.json");
    if (!root || mk_json_write(path, root, &err) != MK_OK ||
        mk_json_read(path, &again, &err) != MK_OK || (size_t)cJSON_GetArraySize(again) != n)
        abort();
    for (const cJSON *item = again->child; item; item = item->next, i++)
        if (isfinite(value[i]) ? !cJSON_IsNumber(item) || item->valuedouble != value[i]
                               : !cJSON_IsNull(item))
            abort();
    cJSON_Delete(again);
    cJSON_Delete(root);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cJSON *root;
    struct mk_error err = MK_ERROR_INIT;
    if (size > 0 && data[0] == '#') {
        numbers(data + 1, size - 1);
        return 0;
    }
    if (mk_json_read(fuzz_file(0, data, size), &root, &err) != MK_OK) {
        if (err.message[0] == '\0')
            abort();
        look_at_error(&err, data, size);
        return 0;
    }
    look_at(root, 0, 0);
    write_and_read(root);
    cJSON_Delete(root);
    return 0;
}
