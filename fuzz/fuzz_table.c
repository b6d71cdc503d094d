/* libFuzzer: other people's files, as `mechkit import` reads them. The first byte chooses the rig,
 * the second what the file is: 'c' text, 'm' a MAT file, 's' a MAT file that is whole and holds
 * what the bytes say (no fuzzer finds its way through lengths and compression). A line "===" ends a
 * mapping that stands before it; without one the names of the columns must do. What is imported is
 * a log with a time that goes forwards from 0. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz_file.h"
#include "fuzz_mat.h"
#include "fuzz_seen.h"
#include "mechkit/exchange.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
const char *__asan_default_options(void);
const char *__lsan_default_suppressions(void);

/* matio asks for what a file claims to need, and takes no for an answer. */
const char *__asan_default_options(void)
{
    return "allocator_may_return_null=1:max_allocation_size_mb=512";
}

/* Its own leaks, where what it reads or writes makes no sense, are not ours. */
const char *__lsan_default_suppressions(void)
{
    return "leak:libmatio\nleak:libz\n";
}

static __attribute__((noinline)) void must(int holds)
{
    if (!holds)
        abort();
}

static const char *put_file(const char *name, const uint8_t *data, size_t size)
{
    const char *path = fuzz_scratch(name);
    FILE *f = fopen(path, "wb");
    must(f && fwrite(data, 1, size, f) == size && fclose(f) == 0);
    return path;
}

static void check_table(const struct mk_table *t)
{
    must(t->rows >= 2 && t->count > 0);
    must(strlen(t->left_out) < sizeof t->left_out);
    fuzz_seen(1u << 24 | fuzz_size(t->rows) << 8 | fuzz_size(t->count));
    fuzz_seen(2u << 24 | fuzz_size(strlen(t->left_out)));
    for (size_t i = 0; i < t->count; i++) {
        const struct mk_table_column *c = &t->column[i];
        double first = c->data[0], last = c->data[t->rows - 1]; /* they are there */
        fuzz_seen(3u << 24 | (uint32_t)(isnan(first) != 0) << 1 | (uint32_t)(isnan(last) != 0));
        must(strlen(c->name) < sizeof c->name && strlen(c->unit) < sizeof c->unit);
        must(strlen(c->text) < sizeof c->text && c->text_line >= 0);
    }
}

static void check_log(const struct mk_log *log, const struct mk_table *table)
{
    const double *t = mk_log_get(log, "t");
    must(t && log->rows == table->rows && t[0] == 0.0);
    for (size_t r = 0; r < log->rows; r++)
        must(isfinite(t[r]) && (r == 0 || t[r] > t[r - 1]));
}

static void check_written(const struct mk_log *log)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_log *again;
    const char *path = fuzz_scratch("log.csv");
    if (mk_log_write(path, log, &err) != MK_OK) {
        must(err.message[0] != '\0');
        return;
    }
    must(mk_log_read(path, &again, &err) == MK_OK && again->rows == log->rows);
    mk_log_free(again);
}

static void check_findings(const struct mk_table *table, const char *path,
                           const struct mk_import_map *map)
{
    static struct mk_import_finding found[MK_IMPORT_FINDINGS];
    struct mk_error err = MK_ERROR_INIT;
    struct mk_import_map again;
    const char *fixed = fuzz_scratch("fixed.map");
    int n = mk_import_check(table, path, map, found);
    must(n >= 0 && n <= MK_IMPORT_FINDINGS);
    for (int i = 0; i < n; i++)
        must(found[i].what[0] != '\0');
    if (n > 0)
        map = &found[n - 1].fixed;
    if (mk_import_map_write(fixed, map, NULL, &err) != MK_OK)
        must(err.message[0] != '\0');
    else
        must(mk_import_map_read(fixed, &again, &err) == MK_OK);
}

static void import(const char *path, struct mk_import_map *map, int by_names)
{
    struct mk_error err = MK_ERROR_INIT;
    struct mk_table *table = NULL;
    struct mk_log *log = NULL;
    enum mk_status st = mk_import_open(path, map, &table, &err);
    if (st == MK_OK) {
        check_table(table);
        if (by_names)
            st = mk_import_guess(table, path, map, &err);
    }
    if (st == MK_OK)
        st = mk_import_apply(table, path, map, &log, &err);
    must((st == MK_OK) == (err.message[0] == '\0'));
    if (st == MK_OK) {
        check_log(log, table);
        check_written(log);
        check_findings(table, path, map);
    }
    mk_log_free(log);
    mk_table_free(table);
}

/* Where the line "===" begins; NULL: nowhere. */
static const uint8_t *end_of_map(const uint8_t *data, size_t size)
{
    for (size_t i = 0; i + 5 <= size; i++)
        if (memcmp(data + i, "\n===\n", 5) == 0)
            return data + i;
    return NULL;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct mk_import_map map = {0};
    struct mk_error err = MK_ERROR_INIT;
    if (size < 2)
        return 0;
    map.rig = (enum mk_plant_kind)(data[0] % MK_PLANT_COUNT);
    char kind = (char)data[1];
    data += 2;
    size -= 2;
    const uint8_t *end = end_of_map(data, size);
    if (end &&
        mk_import_map_read(fuzz_file(0, data, (size_t)(end - data) + 1), &map, &err) != MK_OK)
        return 0;
    if (end) {
        size -= (size_t)(end - data) + 5;
        data = end + 5;
    }
    const char *path = kind == 's'   ? fuzz_scratch("made.mat")
                       : kind == 'm' ? put_file("given.mat", data, size)
                                     : put_file("given.csv", data, size);
    if (kind == 's' && !fuzz_mat(path, data, size))
        return 0;
    import(path, &map, end == NULL);
    return 0;
}
