/* mechkit: the program. Wires the parts together; the subcommands live in sub_*.c. */
#include <stdio.h>
#include <string.h>

int main(int argc, char **argv)
{
    if (argc == 2 && strcmp(argv[1], "--version") == 0) {
        puts("mechkit " MK_VERSION);
        return 0;
    }
    fputs("mechkit: usage: mechkit --version\n", stderr);
    return 2;
}
