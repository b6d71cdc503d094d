/* Layout as in PKWARE's APPNOTE 6.3: a local header before each entry's data, and a directory with
 * the same fields at the end. */
#include "base/zip.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/checksum.h"
#include "base/out_file.h"

#define LIMIT 0x7fffffffu /* of sizes and offsets; the format has 32 bits */

struct archive {
    struct mk_out_file file;
    size_t offset;
    enum mk_status status;
    struct mk_error *err;
};

struct packed {
    Bytef *data;
    uint32_t size, whole, crc, offset;
};

static void put(struct archive *a, const void *data, size_t size)
{
    if (a->status == MK_OK)
        a->status = mk_out_file_write(&a->file, data, size, a->err);
    a->offset += size;
}

/* Little endian, `bytes` of them. */
static void put_number(struct archive *a, uint32_t value, int bytes)
{
    unsigned char out[4];
    for (int i = 0; i < bytes; i++)
        out[i] = (unsigned char)(value >> (8 * i));
    put(a, out, (size_t)bytes);
}

/* The fields that local header and directory share, from "version needed" to "extra length". */
static void put_common(struct archive *a, const struct mk_zip_entry *e, const struct packed *p)
{
    put_number(a, 20, 2);             /* version needed: deflate */
    put_number(a, 0, 2);              /* flags */
    put_number(a, Z_DEFLATED, 2);     /* method */
    put_number(a, 0, 2);              /* time */
    put_number(a, (1u << 5) | 1u, 2); /* date: 1 January 1980, the earliest there is */
    put_number(a, p->crc, 4);
    put_number(a, p->size, 4);
    put_number(a, p->whole, 4);
    put_number(a, (uint32_t)strlen(e->name), 2);
    put_number(a, 0, 2); /* extra */
}

static void put_entry(struct archive *a, const struct mk_zip_entry *e, struct packed *p)
{
    p->offset = (uint32_t)a->offset;
    put_number(a, 0x04034b50, 4);
    put_common(a, e, p);
    put(a, e->name, strlen(e->name));
    put(a, p->data, p->size);
}

static void put_directory(struct archive *a, const struct mk_zip_entry *entries,
                          const struct packed *p, size_t count)
{
    size_t start = a->offset;
    for (size_t i = 0; i < count; i++) {
        put_number(a, 0x02014b50, 4);
        put_number(a, (3u << 8) | 20u, 2); /* made by: Unix */
        put_common(a, &entries[i], &p[i]);
        put_number(a, 0, 2);              /* comment */
        put_number(a, 0, 2);              /* disk */
        put_number(a, 0, 2);              /* internal attributes */
        put_number(a, 0100644u << 16, 4); /* external: a plain file, readable */
        put_number(a, p[i].offset, 4);
        put(a, entries[i].name, strlen(entries[i].name));
    }
    size_t size = a->offset - start;
    put_number(a, 0x06054b50, 4);
    put_number(a, 0, 4); /* disks */
    put_number(a, (uint32_t)count, 2);
    put_number(a, (uint32_t)count, 2);
    put_number(a, (uint32_t)size, 4);
    put_number(a, (uint32_t)start, 4);
    put_number(a, 0, 2); /* comment */
}

/* Deflate without zlib's own header, which ZIP leaves out. */
static enum mk_status pack(const struct mk_zip_entry *e, struct packed *p, struct mk_error *err)
{
    z_stream z = {0};
    if (e->size > LIMIT)
        return mk_error_set(err, MK_ERR_RANGE, "%s is too large for a ZIP archive", e->name);
    if (deflateInit2(&z, Z_BEST_COMPRESSION, Z_DEFLATED, -MAX_WBITS, 9, Z_DEFAULT_STRATEGY) != Z_OK)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory to pack %s", e->name);
    uLong room = deflateBound(&z, (uLong)e->size);
    p->data = malloc(room);
    if (p->data) {
        z.next_in = (Bytef *)(uintptr_t)e->data;
        z.avail_in = (uInt)e->size;
        z.next_out = p->data;
        z.avail_out = (uInt)room;
    }
    bool packed = p->data && deflate(&z, Z_FINISH) == Z_STREAM_END;
    p->size = (uint32_t)z.total_out;
    p->whole = (uint32_t)e->size;
    p->crc = mk_checksum(e->data, e->size);
    deflateEnd(&z);
    return packed ? MK_OK : mk_error_set(err, MK_ERR_NOMEM, "no memory to pack %s", e->name);
}

enum mk_status mk_zip_write(const char *path, const struct mk_zip_entry *entries, size_t count,
                            struct mk_error *err)
{
    struct archive a = {.err = err, .status = MK_OK};
    struct packed *p = calloc(count ? count : 1, sizeof *p);
    if (!p)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
    for (size_t i = 0; a.status == MK_OK && i < count; i++)
        a.status = pack(&entries[i], &p[i], err);
    if (a.status == MK_OK)
        a.status = mk_out_file_open(&a.file, path, err);
    if (a.status == MK_OK) {
        for (size_t i = 0; i < count; i++)
            put_entry(&a, &entries[i], &p[i]);
        put_directory(&a, entries, p, count);
        if (a.status == MK_OK && a.offset > LIMIT)
            a.status = mk_error_set(err, MK_ERR_RANGE, "%s is too large for a ZIP archive", path);
        a.status = mk_out_file_finish(&a.file, a.status, err);
    }
    for (size_t i = 0; i < count; i++)
        free(p[i].data);
    free(p);
    return a.status;
}
