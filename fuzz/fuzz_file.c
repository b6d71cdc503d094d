#include "fuzz_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define FILES 4

const char *fuzz_file(int number, const uint8_t *data, size_t size)
{
    static int fd[FILES] = {-1, -1, -1, -1};
    static char path[FILES][64];
    if (fd[number] < 0) {
        fd[number] = memfd_create("fuzz", 0);
        snprintf(path[number], sizeof path[number], "/proc/self/fd/%d", fd[number]);
    }
    if (ftruncate(fd[number], 0) != 0 || pwrite(fd[number], data, size, 0) != (ssize_t)size)
        abort();
    return path[number];
}

static char folder[] = "/dev/shm/mechkit-fuzz-XXXXXX";

static void remove_folder(void)
{
    char command[100];
    snprintf(command, sizeof command, "rm -rf %s", folder);
    if (system(command) != 0)
        perror(folder);
}

const char *fuzz_scratch(const char *name)
{
    static char path[FILES][100];
    static int made, next;
    if (!made) {
        if (!mkdtemp(folder))
            abort();
        atexit(remove_folder);
        made = 1;
    }
    next = (next + 1) % FILES;
    snprintf(path[next], sizeof path[next], "%s/%s", folder, name);
    return path[next];
}

int fuzz_same_files(const char *a, const char *b)
{
    FILE *f = fopen(a, "rb"), *g = fopen(b, "rb");
    int c = 0, d = 0;
    while (f && g && c == d && c != EOF) {
        c = getc(f);
        d = getc(g);
    }
    int same = f && g && c == d;
    if (f)
        fclose(f);
    if (g)
        fclose(g);
    return same;
}
