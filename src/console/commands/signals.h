/* The signals that ask a program to end: a terminal that was closed, kill, Ctrl-C, a limit of
 * processor time. Wherever the motor may be on they are taken, switch it off, and leave the log
 * complete. */
#ifndef MECHKIT_CONSOLE_COMMANDS_SIGNALS_H
#define MECHKIT_CONSOLE_COMMANDS_SIGNALS_H

struct ending_signal {
    int number;
    const char *name;
};

/* The i-th of them, NULL behind the last. */
const struct ending_signal *signals_ending(int i);

/* Has those of them that are not ignored remove temporary files before they end the program. For
 * commands that do not take them. */
void signals_clean_up(void);

/* Has all of them call `handler`. */
void signals_catch(void (*handler)(int number));

#endif
