#include "mechkit/json.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "mechkit/number.h"

cJSON *mk_json_number(double value)
{
    char text[MK_NUMBER_MAX];
    if (!isfinite(value))
        return cJSON_CreateNull();
    mk_format_double(text, value);
    return cJSON_CreateRaw(text);
}

cJSON *mk_json_numbers(const double *values, size_t count)
{
    cJSON *array = cJSON_CreateArray();
    for (size_t i = 0; array && i < count; i++)
        cJSON_AddItemToArray(array, mk_json_number(values[i]));
    return array;
}

/* Text to a stream, flushed; 0 or an errno. */
static int put_text(FILE *f, const char *text, bool sync)
{
    errno = 0;
    if (fputs(text, f) < 0 || fputc('\n', f) == EOF || fflush(f) != 0 ||
        (sync && fsync(fileno(f)) != 0))
        return errno ? errno : EIO;
    return 0;
}

static int write_atomically(const char *path, const char *text)
{
    size_t size = strlen(path) + 16;
    char *temporary = malloc(size);
    if (!temporary)
        return ENOMEM;
    snprintf(temporary, size, "%s.tmp%d", path, (int)getpid());
    FILE *f = fopen(temporary, "w");
    int why = f ? put_text(f, text, true) : errno;
    if (f && fclose(f) != 0 && !why)
        why = errno;
    if (f && !why && rename(temporary, path) != 0)
        why = errno;
    if (f && why)
        unlink(temporary);
    free(temporary);
    return why;
}

enum mk_status mk_json_write(const char *path, const cJSON *root, struct mk_error *err)
{
    char *text = cJSON_Print(root);
    if (!text)
        return mk_error_at(err, MK_ERR_NOMEM, path, 0, 0, "out of memory");
    int why = strcmp(path, "-") == 0 ? put_text(stdout, text, false) : write_atomically(path, text);
    cJSON_free(text);
    return why ? mk_error_errno(err, why, path, "cannot write") : MK_OK;
}

static char *slurp(const char *path, int *why)
{
    FILE *f = fopen(path, "rb");
    if (!f) {
        *why = errno;
        return NULL;
    }
    size_t used = 0, room = 1 << 14;
    char *text = malloc(room);
    while (text) {
        used += fread(text + used, 1, room - used - 1, f);
        if (used + 1 < room)
            break;
        char *more = realloc(text, room *= 2);
        if (!more)
            free(text);
        text = more;
    }
    *why = !text ? ENOMEM : ferror(f) ? (errno ? errno : EIO) : 0;
    fclose(f);
    if (*why) {
        free(text);
        return NULL;
    }
    text[used] = '\0';
    return text;
}

enum mk_status mk_json_read(const char *path, cJSON **out, struct mk_error *err)
{
    int why = 0;
    *out = NULL;
    char *text = slurp(path, &why);
    if (!text)
        return mk_error_errno(err, why, path, "cannot read");
    const char *end = NULL;
    *out = cJSON_ParseWithOpts(text, &end, true);
    enum mk_status st = MK_OK;
    if (!*out) {
        int line = 1, column = 1;
        for (const char *c = text; end && c < end; c++) {
            column = *c == '\n' ? 1 : column + 1;
            line += *c == '\n';
        }
        st = mk_error_at(err, MK_ERR_PARSE, path, line, column, "this is not JSON");
    }
    free(text);
    return st;
}
