#include "base/log_copy.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

#include "base/log_priv.h"
#include "base/out_file.h"

bool mk_log_paths_agree(const char *one, const char *other)
{
    return mk_log_path_is_compressed(one) == mk_log_path_is_compressed(other);
}

/* errno of a failed call on a stream; errno must have been 0 before it. */
static int failure_of(gzFile stream)
{
    int code = Z_OK, system = errno;
    gzerror(stream, &code);
    return code == Z_MEM_ERROR ? ENOMEM : system ? system : EIO;
}

/* The mode "T" of zlib writes plain text. */
static gzFile open_new(int fd, const char *name)
{
    int own = dup(fd); /* gzclose closes it; what is synchronised is the other */
    gzFile out = own >= 0 ? gzdopen(own, mk_log_path_is_compressed(name) ? "wb6" : "wbT") : NULL;
    if (!out && own >= 0)
        close(own);
    return out;
}

/* Reading undoes a compression and takes plain text as it is. */
static int copy_all(gzFile in, gzFile out)
{
    char block[1 << 14];
    for (;;) {
        errno = 0;
        const int n = gzread(in, block, sizeof block);
        if (n < 0)
            return failure_of(in);
        if (n == 0)
            return 0;
        errno = 0;
        if (gzwrite(out, block, (unsigned)n) != n)
            return failure_of(out);
    }
}

static int copy_to(gzFile in, int fd, const char *name)
{
    gzFile out = open_new(fd, name);
    if (!out)
        return ENOMEM;
    int failure = copy_all(in, out);
    errno = 0;
    if (gzclose_w(out) != Z_OK && !failure)
        failure = errno ? errno : EIO;
    return failure ? failure : mk_sync(fd);
}

int mk_log_copy_new(const char *from, const char *to, const char *name)
{
    errno = 0;
    gzFile in = gzopen(from, "rb");
    if (!in)
        return errno ? errno : ENOMEM;
    const int fd = open(to, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    int failure = fd < 0 ? errno : copy_to(in, fd, name);
    if (fd >= 0 && close(fd) != 0 && !failure)
        failure = errno;
    if (fd >= 0 && failure)
        unlink(to);
    gzclose_r(in);
    return failure;
}

/* A log begins with comments, and one of them is its version. */
bool mk_log_may_replace(const char *path)
{
    static const char version[] = "# " MK_LOG_VERSION_KEY ":";
    char line[256];
    bool begins = true, is_log = false, is_empty = true;
    gzFile in = gzopen(path, "rb");
    while (in && !is_log && gzgets(in, line, sizeof line)) {
        is_empty = false;
        if (begins && line[0] != '#')
            break;
        is_log = begins && strncmp(line, version, sizeof version - 1) == 0;
        begins = strchr(line, '\n') != NULL;
    }
    if (in)
        gzclose_r(in);
    return in && (is_log || is_empty);
}
