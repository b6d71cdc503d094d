/* INI files with the lines that things were in: `[section]`, `key = value`, and comments, as long
 * as they like. A key that is there twice in a section is an error, and so is text behind the ] of
 * a section. */
#ifndef MECHKIT_BASE_INI_FILE_H
#define MECHKIT_BASE_INI_FILE_H

#include <stdbool.h>

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MK_INI_ENTRIES 256
#define MK_INI_TEXT 160

struct mk_ini_entry {
    char section[MK_INI_TEXT], key[MK_INI_TEXT], value[MK_INI_TEXT];
    int line;
    bool used; /* for the caller: what is left unused was not understood */
};

enum mk_ini_comments {
    MK_INI_COMMENTS_ANYWHERE, /* from # or ; to the end of the line */
    /* Values are other people's names, with # and ; in them: # and ; begin a comment at the start
     * of a line, and ; behind a blank. */
    MK_INI_COMMENTS_APART
};

/* Also one without keys. */
struct mk_ini_section {
    char name[MK_INI_TEXT];
    int line; /* the first one of this name */
};

struct mk_ini {
    const char *path; /* the caller's */
    int count, sections;
    struct mk_ini_entry entry[MK_INI_ENTRIES];     /* as in the file */
    struct mk_ini_section section[MK_INI_ENTRIES]; /* each once, as in the file */
};

/* Reads a whole file; `what` it is goes into messages ("the model"). The caller frees *out, which
 * is NULL on failure. MK_ERR_NOTFOUND, MK_ERR_PERM, MK_ERR_IO, MK_ERR_NOMEM, MK_ERR_PARSE. */
MK_NODISCARD enum mk_status mk_ini_read(const char *path, const char *what,
                                        enum mk_ini_comments comments, struct mk_ini **out,
                                        struct mk_error *err);
void mk_ini_free(struct mk_ini *ini); /* NULL allowed */

/* NULL when it is not there. */
struct mk_ini_entry *mk_ini_find(struct mk_ini *ini, const char *section, const char *key);

/* The first entry of a section; NULL when it has none. */
const struct mk_ini_entry *mk_ini_first(const struct mk_ini *ini, const char *section);

/* MK_ERR_PARSE: "key = 'value': expected WANT", with the file and line. */
enum mk_status mk_ini_refuse(const struct mk_ini *ini, const struct mk_ini_entry *e,
                             struct mk_error *err, const char *want);

#ifdef __cplusplus
}
#endif
#endif
