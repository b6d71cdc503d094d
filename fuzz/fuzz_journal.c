/* libFuzzer: what may lie where a sweep wants its journal. Another's file stays as it is; of its
 * own whatever is whole is taken over, and the sweep ends with a result for every run. An input
 * that begins with "@\n" gets this sweep's first line for it, and one with "=\n" also checksums
 * before its lines: no fuzzer guesses a fingerprint. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/checksum.h"
#include "experiment/sweep_journal.h"
#include "fuzz_file.h"

#define INPUT_MAX 8192

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static struct sweep sweep;
static char out[100], journal[120];
static char heading[100];
static size_t heading_size;

static __attribute__((noinline)) void must(int holds)
{
    if (!holds)
        abort();
}

static size_t read_back(char *bytes, size_t room)
{
    FILE *f = fopen(journal, "rb");
    must(f != NULL);
    size_t n = fread(bytes, 1, room, f);
    fclose(f);
    return n;
}

static void set_up(void)
{
    static const char spec[] = "[sweep]\nkind = basin\nruns = 2\n[rig]\nsetup = furuta\n"
                               "[start]\nq2 = -0.1 : 0.1 : 3\n";
    struct mk_error err = MK_ERROR_INIT;
    struct sweep_journal j;
    if (heading_size > 0)
        return;
    must(sweep_read(fuzz_file(0, (const uint8_t *)spec, sizeof spec - 1), &sweep, &err) == MK_OK);
    snprintf(out, sizeof out, "%s", fuzz_scratch("sweep.csv"));
    snprintf(journal, sizeof journal, "%s.journal", out);
    must(sweep_journal_open(&j, &sweep, out, &err) == MK_OK);
    heading_size = read_back(heading, sizeof heading);
    sweep_journal_close(&j, true);
}

/* The lines, each behind its checksum. */
static size_t with_checksums(const uint8_t *data, size_t size, char *bytes)
{
    size_t n = 0;
    for (const uint8_t *end = data + size; data < end && n < INPUT_MAX - 9;) {
        size_t room = INPUT_MAX - 9 - n, rest = (size_t)(end - data);
        const uint8_t *stop = memchr(data, '\n', rest);
        size_t line = stop ? (size_t)(stop - data) : rest, all = line + (stop != NULL);
        line = line < room ? line : room;
        all = all < room ? all : room;
        n += (size_t)snprintf(bytes + n, 10, "%08" PRIx32 " ", mk_checksum(data, line));
        memcpy(bytes + n, data, all);
        n += all;
        data += all;
    }
    return n;
}

static size_t with_heading(const uint8_t *data, size_t size, char *bytes)
{
    bool sealed = size >= 2 && memcmp(data, "=\n", 2) == 0;
    bool own = sealed || (size >= 2 && memcmp(data, "@\n", 2) == 0);
    size_t skip = own ? 2 : 0, first = own ? heading_size : 0;
    size = size - skip < INPUT_MAX ? size - skip : INPUT_MAX;
    memcpy(bytes, heading, first);
    if (sealed)
        size = with_checksums(data + skip, size, bytes + first);
    else
        memcpy(bytes + first, data + skip, size);
    FILE *f = fopen(journal, "wb");
    must(f && fwrite(bytes, 1, first + size, f) == first + size && fclose(f) == 0);
    return first + size;
}

/* The rest of the runs, each with a result that is in the file afterwards. */
static void finish(struct sweep_journal *j, const char *text)
{
    struct mk_error err = MK_ERROR_INIT;
    struct sweep_journal again;
    for (size_t i = 0; i < sweep.total; i++)
        if (!j->result[i].text)
            must(sweep_journal_add(j, i, (int)(i % 2), text, &err) == MK_OK);
    must(j->done == sweep.total && sweep_write_csv(j, out, &err) == MK_OK);
    sweep_journal_close(j, false);
    must(sweep_journal_open(&again, &sweep, out, &err) == MK_OK && again.done == sweep.total);
    sweep_journal_close(&again, true);
    unlink(out);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static char before[INPUT_MAX + sizeof heading], after[INPUT_MAX + 2 * sizeof heading];
    struct sweep_journal j;
    struct mk_error err = MK_ERROR_INIT;
    set_up();
    size_t n = with_heading(data, size, before);
    enum mk_status st = sweep_journal_open(&j, &sweep, out, &err);
    size_t left = read_back(after, sizeof after);
    if (st != MK_OK) {
        must(err.message[0] != '\0' && left == n && memcmp(before, after, n) == 0);
        sweep_journal_close(&j, false);
        return 0;
    }
    /* Its own, or what is left of the first line after a kill. */
    size_t same = n < heading_size ? n : heading_size;
    must(memcmp(before, heading, same) == 0);
    must(left >= heading_size && left <= (n > heading_size ? n : heading_size));
    must(memcmp(after, heading, heading_size) == 0 && j.done <= sweep.total);
    must(n < left || memcmp(before, after, left) == 0);
    finish(&j, "0.5,,1e-3");
    return 0;
}
