#include "console/commands/signals.h"

#include <signal.h>
#include <stddef.h>
#include <string.h>

static const struct ending_signal enders[] = {{SIGHUP, "SIGHUP (the terminal was closed)"},
                                              {SIGTERM, "SIGTERM"},
                                              {SIGINT, "SIGINT"},
                                              {SIGQUIT, "SIGQUIT"},
                                              {SIGUSR1, "SIGUSR1"},
                                              {SIGUSR2, "SIGUSR2"},
                                              {SIGALRM, "SIGALRM"},
                                              {SIGXCPU, "SIGXCPU (no more processor time)"}};

const struct ending_signal *signals_ending(int i)
{
    return i >= 0 && (size_t)i < sizeof enders / sizeof enders[0] ? &enders[i] : NULL;
}

void signals_catch(void (*handler)(int number))
{
    struct sigaction action;
    const struct ending_signal *s;
    memset(&action, 0, sizeof action);
    action.sa_handler = handler;
    sigemptyset(&action.sa_mask);
    for (int i = 0; (s = signals_ending(i)) != NULL; i++)
        sigaction(s->number, &action, NULL);
}
