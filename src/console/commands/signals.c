#include "console/commands/signals.h"

#include <signal.h>
#include <stddef.h>
#include <string.h>

#include "base/temporary.h"

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

static void on_ending(int number)
{
    mk_temporary_remove();
    signal(number, SIG_DFL);
    raise(number); /* arrives when this function returns */
}

void signals_clean_up(void)
{
    struct sigaction before, action = {.sa_handler = on_ending};
    const struct ending_signal *s;
    sigemptyset(&action.sa_mask);
    for (int i = 0; (s = signals_ending(i)) != NULL; i++)
        if (sigaction(s->number, NULL, &before) == 0 && before.sa_handler != SIG_IGN)
            sigaction(s->number, &action, NULL);
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
