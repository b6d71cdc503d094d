/* The command line: editing, history, completion. */
#ifndef MECHKIT_CONSOLE_SCREEN_TUI_PROMPT_H
#define MECHKIT_CONSOLE_SCREEN_TUI_PROMPT_H

#include "console/screen/tui_canvas.h"
#include "console/script/host.h"

#define PROMPT_TEXT 400
#define PROMPT_HISTORY 200

struct tui_prompt {
    const char *label;      /* before the text; static */
    char text[PROMPT_TEXT]; /* UTF-8 */
    int at;                 /* byte of the cursor */
    char history[PROMPT_HISTORY][PROMPT_TEXT];
    int lines, back;         /* back: how far into the history; 0: the line being typed */
    int typed_lines;         /* of them, typed since the program began */
    char typed[PROMPT_TEXT]; /* the line being typed, while the history is shown */
    char hint[PROMPT_TEXT];  /* candidates of the last completion; "": none */
};

enum prompt_answer { PROMPT_GOES_ON, PROMPT_DONE, PROMPT_LEFT };

void prompt_open(struct tui_prompt *p, const char *label, const char *text);
/* Status: what names are completed with. */
enum prompt_answer prompt_key(struct tui_prompt *p, int key, const struct host_status *status);
void prompt_remember(struct tui_prompt *p, const char *line);
void prompt_draw(const struct tui_prompt *p, struct canvas *c, int row);

/* Completes the word before byte `at` of `text`: writes candidates, separated by blanks, to `list`
 * and returns how many there are; `common` gets what they all begin with. */
int complete(const char *text, int at, const struct host_status *status, char *common,
             size_t common_size, char *list, size_t list_size);
/* The arguments of the command that is being typed, "" if there is none of that name. */
void complete_usage(const char *text, char *buf, size_t size);

#endif
