/* Files and folders that are there for a while only. Their names say which process made them, so
 * that the next one finds what a killed program left; and they are listed while they are there, so
 * that a program that a signal ends can remove its own. */
#ifndef MECHKIT_BASE_TEMPORARY_H
#define MECHKIT_BASE_TEMPORARY_H

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Lists a file, or a folder, which is removed when it is empty. `path` is from malloc and stays as
 * it is until mk_temporary_done. NULL allowed. Where the list is full the path is left out of it.
 */
void mk_temporary_add(const char *path);
/* Takes it off the list and frees it; what it names has been removed or renamed. Does not return
 * where a signal that ends the program is removing it. NULL allowed. */
void mk_temporary_done(char *path);
/* Removes all that is listed. Async-signal-safe, and the program has to end after it. */
void mk_temporary_remove(void);

/* Removes temporary files of this target that a killed program left: "TARGET.PID-WHATEVER.tmp"
 * whose process is gone and that nobody has locked. */
void mk_temporary_clean(const char *target);

/* A folder of this process: WHERE/NAME.PID-WHATEVER.tmp. Folders of this name that a killed program
 * left there are removed first. */
struct mk_temporary_folder {
    char *path;
    int lock; /* descriptor of the folder, which is locked */
};

/* `where` NULL: $TMPDIR, or /tmp. On failure there is nothing to close. The error names the folder
 * in which there can be none. */
MK_NODISCARD enum mk_status mk_temporary_folder_open(struct mk_temporary_folder *folder,
                                                     const char *where, const char *name,
                                                     struct mk_error *err);
/* Removes the folder with the files in it. */
void mk_temporary_folder_close(struct mk_temporary_folder *folder);

#ifdef __cplusplus
}
#endif
#endif
