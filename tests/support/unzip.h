/* Unpacks a ZIP archive by reading its local headers in turn, checking sizes and sums: a reader of
 * its own, to hold the writer against. */
#ifndef MECHKIT_TESTS_SUPPORT_UNZIP_H
#define MECHKIT_TESTS_SUPPORT_UNZIP_H

/* Makes the folders it needs under `dir`. Returns the number of files; fails the test on anything
 * that is not as the format says. `names` (may be NULL) gets their names, a line each. */
int unzip_all(const char *path, const char *dir, char *names, unsigned long size);

#endif
