#include "support/unzip.h"

#include <check.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#define ZLIB_CONST /* input is not written to */
#include <zlib.h>

static uint32_t number(const unsigned char *p, int bytes)
{
    uint32_t value = 0;
    for (int i = 0; i < bytes; i++)
        value |= (uint32_t)p[i] << (8 * i);
    return value;
}

static void make_folders(char *path)
{
    for (char *slash = strchr(path + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        *slash = 0;
        mkdir(path, 0777);
        *slash = '/';
    }
}

/* One entry at `p`; returns how long it is. */
static size_t unpack(const unsigned char *p, size_t left, const char *dir, char *name)
{
    ck_assert_uint_gt(left, 30);
    size_t packed = number(p + 18, 4), whole = number(p + 22, 4), length = number(p + 26, 2);
    size_t head = 30 + length + number(p + 28, 2);
    ck_assert_uint_eq(number(p + 8, 2), Z_DEFLATED);
    ck_assert_uint_le(head + packed, left);
    ck_assert_uint_lt(length, 200);
    memcpy(name, p + 30, length);
    name[length] = 0;
    unsigned char *data = malloc(whole + 1);
    z_stream z = {.next_in = p + head,
                  .avail_in = (unsigned)packed,
                  .next_out = data,
                  .avail_out = (unsigned)whole + 1};
    ck_assert_int_eq(inflateInit2(&z, -MAX_WBITS), Z_OK);
    ck_assert_int_eq(inflate(&z, Z_FINISH), Z_STREAM_END);
    ck_assert_uint_eq(z.total_out, whole);
    inflateEnd(&z);
    ck_assert_uint_eq(crc32(0, data, (unsigned)whole), number(p + 14, 4));
    char path[512];
    snprintf(path, sizeof path, "%s/%s", dir, name);
    make_folders(path);
    FILE *f = fopen(path, "wb");
    ck_assert_ptr_nonnull(f);
    ck_assert_uint_eq(fwrite(data, 1, whole, f), whole);
    fclose(f);
    free(data);
    return head + packed;
}

/* The directory at the end repeats what the entries say. */
static void check_directory(const unsigned char *p, size_t left, int count)
{
    const unsigned char *start = p;
    for (int i = 0; i < count; i++) {
        ck_assert_uint_gt(left, 46);
        ck_assert_uint_eq(number(p, 4), 0x02014b50);
        size_t length = 46 + number(p + 28, 2) + number(p + 30, 2) + number(p + 32, 2);
        ck_assert_uint_lt(length, left);
        p += length, left -= length;
    }
    ck_assert_uint_eq(left, 22);
    ck_assert_uint_eq(number(p, 4), 0x06054b50);
    ck_assert_uint_eq(number(p + 10, 2), (unsigned)count);
    ck_assert_uint_eq(number(p + 12, 4), (size_t)(p - start));
}

int unzip_all(const char *path, const char *dir, char *names, unsigned long size)
{
    FILE *f = fopen(path, "rb");
    ck_assert_msg(f != NULL, "%s", path);
    static unsigned char data[1 << 20];
    size_t n = fread(data, 1, sizeof data, f), at = 0;
    fclose(f);
    ck_assert_uint_lt(n, sizeof data);
    int count = 0;
    if (names)
        *names = 0;
    while (at + 4 < n && number(data + at, 4) == 0x04034b50) {
        char name[256];
        at += unpack(data + at, n - at, dir, name);
        if (names)
            snprintf(names + strlen(names), size - strlen(names), "%s\n", name);
        count++;
    }
    check_directory(data + at, n - at, count);
    return count;
}
