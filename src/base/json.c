#include "mechkit/json.h"

#include <errno.h>
#include <locale.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/out_file.h"
#include "mechkit/number.h"

cJSON *mk_json_number(double value)
{
    char text[MK_NUMBER_MAX];
    if (!isfinite(value))
        return cJSON_CreateNull();
    mk_format_double(text, value);
    return cJSON_CreateRaw(text); /* cJSON's own numbers are rounded */
}

cJSON *mk_json_numbers(const double *values, size_t count)
{
    cJSON *array = cJSON_CreateArray();
    for (size_t i = 0; array && i < count; i++) {
        cJSON *item = mk_json_number(values[i]);
        if (!item || !cJSON_AddItemToArray(array, item)) {
            cJSON_Delete(item);
            cJSON_Delete(array);
            return NULL;
        }
    }
    return array;
}

static enum mk_status no_memory(const char *path, struct mk_error *err)
{
    return mk_error_at(err, MK_ERR_NOMEM, path, 0, 0, "out of memory");
}

/* cJSON reads and prints its own numbers in the locale of the thread: give it the plain one. */
static char *print_plain(const cJSON *root)
{
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (plain == (locale_t)0)
        return NULL;
    locale_t before = uselocale(plain);
    char *text = cJSON_Print(root);
    uselocale(before);
    freelocale(plain);
    return text;
}

static cJSON *parse_plain(const char *text, const char **stopped)
{
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (plain == (locale_t)0)
        return NULL;
    locale_t before = uselocale(plain);
    cJSON *root = cJSON_ParseWithOpts(text, stopped, true);
    uselocale(before);
    freelocale(plain);
    return root;
}

static enum mk_status write_stdout(const char *text, struct mk_error *err)
{
    errno = 0;
    if (fputs(text, stdout) < 0 || putchar('\n') < 0 || fflush(stdout) != 0)
        return mk_error_errno(err, errno ? errno : EIO, "standard output", "cannot write");
    return MK_OK;
}

static enum mk_status write_file(const char *path, const char *text, struct mk_error *err)
{
    struct mk_out_file file;
    enum mk_status st = mk_out_file_open(&file, path, err);
    if (st != MK_OK)
        return st;
    st = mk_out_file_write(&file, text, strlen(text), err);
    if (st == MK_OK)
        st = mk_out_file_write(&file, "\n", 1, err);
    return mk_out_file_finish(&file, st, err);
}

enum mk_status mk_json_write(const char *path, const cJSON *root, struct mk_error *err)
{
    char *text = print_plain(root);
    if (!text)
        return no_memory(path, err);
    enum mk_status st =
        strcmp(path, "-") == 0 ? write_stdout(text, err) : write_file(path, text, err);
    cJSON_free(text);
    return st;
}

/* The whole file, NUL-terminated; the caller frees it. */
static enum mk_status read_file(const char *path, char **text, size_t *size, struct mk_error *err)
{
    FILE *file = fopen(path, "rbe");
    if (!file)
        return mk_error_errno(err, errno, path, "cannot read");
    enum mk_status st = MK_OK;
    size_t room = 0, used = 0;
    char *all = NULL;
    for (bool more = true; st == MK_OK && more;) {
        room = room ? 2 * room : 1u << 16;
        char *larger = realloc(all, room);
        if (!larger) {
            st = no_memory(path, err);
            break;
        }
        all = larger;
        errno = 0;
        size_t wanted = room - 1 - used, got = fread(all + used, 1, wanted, file);
        used += got;
        more = got == wanted;
        if (ferror(file))
            st = mk_error_errno(err, errno ? errno : EIO, path, "cannot read");
    }
    fclose(file);
    if (st != MK_OK) {
        free(all);
        return st;
    }
    all[used] = '\0';
    *text = all;
    *size = used;
    return MK_OK;
}

/* Line and column (both from 1) of `at`, and what stands there. */
static enum mk_status malformed(const char *path, const char *text, const char *at,
                                struct mk_error *err)
{
    int line = 1;
    const char *start = text;
    for (const char *p = text; p < at; p++)
        if (*p == '\n') {
            line++;
            start = p + 1;
        }
    int column = (int)(at - start) + 1;
    char found[24];
    size_t n = 0;
    for (; at[n] >= ' ' && at[n] < 0x7f && n < sizeof found - 1; n++)
        found[n] = at[n];
    found[n] = '\0';
    if (!text[strspn(text, " \t\r\n")])
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, "the file is empty: expected JSON");
    return mk_error_at(err, MK_ERR_PARSE, path, line, column, "malformed JSON %s%s%s",
                       n ? "at '" : "here: it ends, or has a character that cannot be shown", found,
                       n ? "'" : "");
}

enum mk_status mk_json_read(const char *path, cJSON **out, struct mk_error *err)
{
    *out = NULL;
    char *text = NULL;
    size_t size = 0;
    enum mk_status st = read_file(path, &text, &size, err);
    if (st != MK_OK)
        return st;
    const char *stopped = text;
    cJSON *root = parse_plain(text, &stopped);
    if (!root) {
        st = malformed(path, text, stopped, err);
    } else if (strlen(text) < size) { /* cJSON took a NUL byte for the end */
        st = malformed(path, text, text + strlen(text), err);
        cJSON_Delete(root);
    } else {
        *out = root;
    }
    free(text);
    return st;
}
