/*
 * Check writes a message for each assertion that holds, to tell where a test was when it died, and
 * copies its whole buffer to read one: minutes, where a test looks at a million numbers. The linker
 * puts this in its place (Makefile, --wrap); sanitizers and cores tell where a test died.
 */
void __wrap__mark_point(const char *file, int line);
void __wrap__mark_point(const char *file, int line)
{
    (void)file;
    (void)line;
}
